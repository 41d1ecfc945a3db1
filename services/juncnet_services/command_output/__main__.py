from juncnet_services.command_output.service import main

main()
