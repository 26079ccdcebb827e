"""python -m hertzloop"""

from hertzloop.cli import main

main()
