"""A bench simulated by other engines: rods by MuJoCo, images by Mitsuba 3. For test only, never for training."""
