"""Parts of tops, coats and dresses: body, neck, sleeves, armholes and a front opening."""
