"""`rcdn live`: a page on this machine that guides somebody through calibrating a camera.

The session (`session`) takes frames, asks the guide and keeps what it accepts (`folder`); the server (`server`, `security`) is the only way to
it from outside; the page (`page/`) shows it. The engine that knows what to ask for is `rcdn.calibration.guidance`; what is written at
the end comes from whoever starts a session, as a function.
"""
