"""The longest that detection takes: pictures made to cost much (`pictures`), and their time a megapixel beside that of photographs (`run`)."""
