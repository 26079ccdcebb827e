"""python -m hertzloop, and the command `hertzloop`"""

from hertzloop.processes.signals import command_line


def load() -> None:
    """Import what the roles of a run need."""
    import hertzloop.loop.controller_node
    import hertzloop.loop.plant_node
    import hertzloop.processes.roles  # noqa: F401
    from hertzloop.commands import cli

    cli.built()


def main() -> None:
    """Entry point: the command line, with imports that can be interrupted quietly."""
    with command_line() as imported:
        from hertzloop.commands import cli

        commands = cli.built()
        imported()
        cli.main(commands)


if __name__ == "__main__":
    main()
