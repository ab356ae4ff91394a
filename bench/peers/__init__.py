"""Speed and accuracy compared with packages of the registry that a user could take instead."""
