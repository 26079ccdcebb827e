"""What several studies' tests run their cases in."""

import pytest

from hertzloop.studies.cases.pool import local_pool


@pytest.fixture(scope="session")
def pool():
    with local_pool(1) as found:
        yield found
