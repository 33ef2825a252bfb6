"""`python -m trackprofile` is the command `trackprofile`."""

from trackprofile.cli import main

if __name__ == "__main__":
    main()
