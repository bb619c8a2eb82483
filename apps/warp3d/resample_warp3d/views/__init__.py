"""Several sources of one picture: depths and colors matched, outliers voted out, blended."""
