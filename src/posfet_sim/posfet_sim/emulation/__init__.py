"""The simulated board as a participant of a bus, in real time or offline, with link faults."""
