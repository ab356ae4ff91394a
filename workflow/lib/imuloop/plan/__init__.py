"""From a calibration to the next recording: what another would bring, before it is made."""
