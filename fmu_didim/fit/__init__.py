"""The engine: sensitivities, least squares, noise, covariance, estimates."""
