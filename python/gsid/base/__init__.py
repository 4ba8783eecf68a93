"""What every package uses: errors, arguments, bands, files."""
