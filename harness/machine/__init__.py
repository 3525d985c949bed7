"""Facts about the machine and the software, and differences between operating systems."""
