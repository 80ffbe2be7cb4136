"""A reconstruction method that is no part of sldvexp."""
