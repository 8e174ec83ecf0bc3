"""The commands of `amb`, one module per subject; what is slow to import is imported inside the commands."""
