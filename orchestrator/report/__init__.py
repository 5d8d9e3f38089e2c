"""One offline HTML page a run, a campaign or a comparison; and its figures as pictures."""
