"""What detection costs, in time and memory, beside other detectors on the same pictures: `rcdn bench`.

Nothing is imported here: whoever asks for memory (`resident`) must not take any.
"""
