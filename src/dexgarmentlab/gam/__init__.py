"""The affordance model on the command line: clouds from files and garments, pictures, runs."""
