"""Which remedy against a deadzone is worth what?"""
