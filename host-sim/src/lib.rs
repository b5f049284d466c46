//! SPLASH simulator.
