from juncnet_services.junction_inference.service import main

main()
