"""FMUs in processes of their own."""
