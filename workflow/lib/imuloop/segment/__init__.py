"""From the samples of a session to its segments: rests, motion, disturbances and gaps."""
