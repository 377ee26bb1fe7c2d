r"""Training of the networks of `tipforce.vision.keypoints`, on simulated images and their true centrelines.

The datasets (about an hour on two cores; the presets' seed 0 is for reporting and not among them):

    tipforce simulate --as dataset --preset varied --samples 5400 --samples-per-session 6 --seconds 16 --seed 9100 \
        --set 'cameras.sizes=[[640,480],[800,600],[640,512]]' -o V
    tipforce simulate --as dataset --preset generalise --samples 720 --samples-per-session 6 --seconds 16 \
        --seed 9200 -o G
    tipforce simulate --as dataset --preset bench-2021 --samples 300 --samples-per-session 6 --seed 9300 -o B
    tipforce simulate --as dataset --preset fluoro --samples 600 --samples-per-session 6 --seconds 16 --seed 9400 -o F

Then `python -m bench.keypoints.train coarse V G B F -o DIR`, the same with `refine`, and `python -m
bench.keypoints.probability`.
"""
