"""From samples to segments: rests, motion, disturbances."""
