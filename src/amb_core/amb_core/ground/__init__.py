"""What every room uses: errors, units, parameters, files, results, tasks."""
