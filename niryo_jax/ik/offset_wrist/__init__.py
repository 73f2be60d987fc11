"""Every solution of offset-wrist arms: one equation in one unknown, and a scan with a proof."""
