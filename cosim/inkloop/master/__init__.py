"""The co-simulation master: steps of components, and values between them."""
