"""The command line.

Each command, or each few that belong together, has a module. `commands` lists them and loads each when it is asked for.
This room stands on top: it alone knows typer, and no other room knows it.
"""
