"""FMUs and systems of other tools, in checked-out public repositories: what ``fmu check`` says of them."""
