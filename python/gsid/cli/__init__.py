"""The `gsid` command.

Each verb is a file `gsid/cli/<verb>.py` that holds a click command of the same name, and a line in
`main.VERBS`. A verb imports what is heavy inside its function, so that `gsid --help` is quick. It prints data
on stdout and talk on stderr (`output.say`), raises `InputError` for bad data and `click.UsageError` for bad
options, and leaves with `ctx.exit(common.EXIT_CRITERION)` where the criterion that was asked for is not met.
`main` turns exceptions into words and exit codes. With --json too an error is words on stderr: what reads the
pipe gets one whole object or nothing.
"""
