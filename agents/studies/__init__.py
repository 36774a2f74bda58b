"""Studies: the source documents' experiments again, their figures beside ours, and their claims."""
