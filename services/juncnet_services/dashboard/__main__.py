"""`python -m juncnet_services.dashboard`."""

from juncnet_services.dashboard.service import main

main()
