"""What systems do differently, behind one face (`here.SYSTEM`)."""
