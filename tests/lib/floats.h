/* Order of floats, for g_array_sort() and qsort(). */
#pragma once

static inline int floats_by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}
