"""Training of the locator: one network that finds the catheter in any image, with or without prompts.

    python -m bench.locator.train -o DIR [--resume]        trains; a checkpoint is written every few minutes
    python -m bench.locator.sheet -o sheet.png             draws some training windows with their targets
    python -m bench.locator.export DIR/locator.pt OUT.onnx writes the graph that the library uses
    python -m bench.locator.judge DIR/locator.pt           judges a checkpoint on worlds it was not trained on

The training images are made while the network trains and are never stored. Two sources alternate: a light compositor
(``scene``: any catheter on any bench, no physics) and the renderers of the simulation's presets (``presets``).
"""
