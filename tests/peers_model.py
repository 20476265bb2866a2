"""Maps random points with random cameras of the reference model. Prints JSON."""
import json
import sys

import numpy as np

sys.path.insert(0, sys.argv[1])
from model import f_3d_to_pix, f_pix_to_3d, to_opencv  # noqa: E402

rng = np.random.default_rng(5)
cases = []
for k in range(400):
    w, h = 1920, 1080
    camera = dict(x0=rng.uniform(-5, 5), y0=rng.uniform(-5, 5), z0=rng.uniform(2, 6), roll=rng.uniform(-.5, .5),
                  pitch=rng.uniform(-.1, 1.4), yaw=rng.uniform(-3.1, 3.1), focal=rng.uniform(700, 2500), w=w, h=h)
    lens = None
    if k % 2:
        lens = [rng.uniform(-.25, .1), rng.uniform(-.05, .1), rng.uniform(-.002, .002), rng.uniform(-.002, .002),
                rng.uniform(-.01, .01)]
    rotation, translation, _ = to_opencv(**camera)
    rays = np.stack([rng.uniform(-.5, .5, 10), rng.uniform(-.3, .3, 10), np.ones(10)], 1) * rng.uniform(1, 15, (10, 1))
    world = (rays - translation) @ rotation
    pixels = f_3d_to_pix(world, **camera, dist=lens)
    floor = f_pix_to_3d(pixels, 0.0, **camera, dist=lens)[:, :2]
    cases.append(dict(camera=camera, lens=lens, rotation=rotation.tolist(), world=world.tolist(),
                      pixels=pixels.tolist(), floor=np.where(np.isfinite(floor), floor, 1e300).tolist()))
json.dump(cases, sys.stdout)
