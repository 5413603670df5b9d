"""How fast may it go, and where on the route does that bind?"""
