"""What a child process that runs foreign code may do, held by the kernel."""
