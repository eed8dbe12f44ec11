/* Directions and colours as arrays of floats, for large tables. */
#pragma once

/* Computes the unit vector with the polar angle θ (from +z) and the azimuth φ (from +x,
 * counter-clockwise as seen from +z), both in degrees. */
void direction_from_deg(double theta_deg, double phi_deg, float ret[3]);

/* Returns the luminance Y = 0.2126 R + 0.7152 G + 0.0722 B of a colour in linear sRGB. */
float rgb_luminance(const float rgb[3]);
