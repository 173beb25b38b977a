"""FMI: one FMU described without running its code, opened, driven; its archive; how our own are built."""
