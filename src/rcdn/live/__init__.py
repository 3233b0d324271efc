"""`rcdn live`: a local web page that guides the user through calibrating a camera.

The session (`session`) receives frames, evaluates them by the guide and stores the accepted ones (`folder`); the server
(`server`, `security`) is the only access to it from outside; the page (`page/`) displays it.
`rcdn.calibration.guidance` chooses the views to ask for; the function that writes the results is passed in by the
caller that starts a session.
"""
