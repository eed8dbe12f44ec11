/*
 * CIEDE2000, the difference of two colours. A difference of 1 can just be seen. Any thread.
 */
#pragma once

/* Converts linear sRGB, in which 1 is white, to CIE L*a*b* under D65. Negative values count as
 * 0. Values above 1 are not limited. */
void delta_e_lab(const float rgb[3], double ret[3]);
/* Returns CIEDE2000 (Sharma, Wu & Dalal 2005) with all factors 1. */
double delta_e_2000(const double lab1[3], const double lab2[3]);
