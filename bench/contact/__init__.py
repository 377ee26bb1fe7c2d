"""Training of the network that reads the geometry of the contact at the tip (`tipforce.vision.contact`)."""
