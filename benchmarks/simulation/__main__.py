"""What the simulated board costs and how exact it is: `python -m benchmarks.simulation [PART ...]`."""

from benchmarks.simulation.runs import main

if __name__ == "__main__":
    main()
