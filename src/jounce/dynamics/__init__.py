"""The equations of motion: in closed form, as the paper prints them, and by recursion."""
