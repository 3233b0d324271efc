"""Good JSON made bad, for tests of readers."""


def edit(*keys, value):
    """A change to a good file: the value at `keys` replaced (or removed, if `value` is ...)."""

    def change(data):
        for key in keys[:-1]:
            data = data[key]
        if value is ...:
            del data[keys[-1]]
        else:
            data[keys[-1]] = value

    return change
