"""What tops, coats and dresses are composed of: body, neck, sleeves, armholes and a front opening."""
