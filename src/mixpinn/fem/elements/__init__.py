"""Elements, their assembly and the elastic system."""
