"""Studies: what the methods are worth on takes whose truth is known, one file each."""
