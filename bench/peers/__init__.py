"""Speed and accuracy, compared with other packages of the registry that users would take."""
