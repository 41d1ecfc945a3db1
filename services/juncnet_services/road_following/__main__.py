"""`python -m juncnet_services.road_following`."""

from juncnet_services.road_following.service import main

main()
