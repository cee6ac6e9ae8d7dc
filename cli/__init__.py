"""The command line.

Each command, or small group of commands, has a module. `commands` lists them and loads each when it is needed. This
room stands on top: only it knows typer, and no other room imports it.
"""
