"""What people read: figures, pages, and the state of a project."""
