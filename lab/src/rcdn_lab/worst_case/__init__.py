"""The longest detection times: pictures designed to be slow (`pictures`), and their time per megapixel relative to
photographs (`run`)."""
