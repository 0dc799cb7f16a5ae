"""The least fuel for inspecting all points: sightings, a linear program for the burns, and a search over both."""
