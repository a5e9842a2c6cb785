"""What a robot is: the frozen data of its mechanism, and passes from mechanism to mechanism."""
