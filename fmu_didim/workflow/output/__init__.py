"""What the verbs return, and the files that they write."""
