"""A page on which an avatar is looked at, moved and edited live."""
