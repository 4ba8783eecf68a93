"""The `gsid` command.

Each verb is a file `gsid/cli/<verb>.py` that holds a click command of the same name, and a line in
`main.VERBS`. A verb imports what is heavy inside its function, so that `gsid --help` is quick. It prints
data on stdout and messages on stderr (`output.say`), raises `InputError` for bad data and
`click.UsageError` for bad options, and leaves with `ctx.exit(common.EXIT_CRITERION)` if a requested
criterion is not met. `main` turns exceptions into messages and exit codes. With --json too an error is a
message on stderr: a program that reads the pipe gets one whole object or nothing.
"""
