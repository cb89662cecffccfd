"""ATI Net F/T, ATI Axia Ethernet and OnRobot HEX: six numbers in a UDP packet, thousands of times a second."""
