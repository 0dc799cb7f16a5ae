"""The chief's sphere of points: where they are, which are seen and lit, and how they cluster."""
