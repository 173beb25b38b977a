"""What lies on disk: the folders that run, study and compare leave, read and written."""
