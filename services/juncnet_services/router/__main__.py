from juncnet_services.router.service import main

main()
