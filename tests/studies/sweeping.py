"""What the tests of sweeps share: a coarse model, one worker."""

from hertzloop.studies.sweep.request import SweepRequest

COARSE = ["run.accuracy=0.05"]
ONE_WORKER = SweepRequest(workers=1)
