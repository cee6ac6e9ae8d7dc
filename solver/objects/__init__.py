"""Objects from outside: mesh files, volumes, and the text that names an object."""
