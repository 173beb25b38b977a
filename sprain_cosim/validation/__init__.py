"""Is the software right, and is it the model of the paper? Numbered checks, each with numbers beside what they should
be; the credibility report.

check (what a check is) - laboratory (what it measures with) - checks/ (one module a subject) - suite (runs them) -
credibility, writers (what is written)."""
