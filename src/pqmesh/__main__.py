"""`python -m pqmesh` is the command."""

from pqmesh.cli import main

if __name__ == "__main__":
    main()
