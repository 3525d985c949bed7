"""The commands of `python -m harness`, one file each; each adds itself to the typer app."""
