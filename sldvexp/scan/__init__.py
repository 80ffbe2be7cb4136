"""Where the beam is sent: scan lines over circles, regions of interest, and lists of both."""
