"""The `gsid` command.

Each verb is a file `gsid/cli/<verb>.py` that contains a click command of the same name, and a line in
`main.VERBS`. Heavy modules are imported inside the functions of a verb, so that `gsid --help` is quick.

A verb prints data on stdout and messages on stderr (`output.print_message`). It raises `InputError` for bad
data and `click.UsageError` for bad options, and exits with `common.EXIT_CRITERION` if a requested criterion
is not met. `main` turns exceptions into messages and exit codes. With --json too, errors are messages on
stderr: a program that reads the pipe receives one whole object or nothing.
"""
