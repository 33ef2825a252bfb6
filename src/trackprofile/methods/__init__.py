"""Published methods of finding the profile, beside the smoother."""
