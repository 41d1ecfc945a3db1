"""`python -m juncnet_services.cli COMMAND ...`: as `juncnet COMMAND ...`."""

from juncnet_services.cli.main import main

main()
