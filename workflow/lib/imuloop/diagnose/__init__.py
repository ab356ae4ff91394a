"""From residuals to the effects that the model lacks."""
