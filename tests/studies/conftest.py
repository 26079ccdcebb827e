"""What several studies' tests run their cases in."""

from collections.abc import Iterator

import pytest

from hertzloop.studies.cases.evaluate import Pool
from hertzloop.studies.cases.pool import local_pool


@pytest.fixture(scope="session")
def pool() -> Iterator[Pool]:
    with local_pool(1) as found:
        yield found
