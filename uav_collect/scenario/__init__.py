"""What missions are flown in: the scenario, its files, the site it is laid out on."""
