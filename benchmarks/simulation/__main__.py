"""Run time and accuracy of the simulated board: `python -m benchmarks.simulation [PART ...]`."""

from benchmarks.simulation.runs import main

if __name__ == "__main__":
    main()
