"""`python -m juncnet_services.simulator`."""

from juncnet_services.simulator.service import main

main()
