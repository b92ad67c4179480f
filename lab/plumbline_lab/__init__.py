"""Experiments with Plumbline: many flights by `plumbline replay`, one table of their reports, figures drawn from it."""


class LabError(Exception):
    """Error that ends a command with a message for the operator."""
