"""A person who is not there, at the other end of a socket."""
