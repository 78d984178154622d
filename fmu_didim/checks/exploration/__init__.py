"""What a search, profiles and sensitivities say of an answer, or before one."""
