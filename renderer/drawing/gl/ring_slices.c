#include "ring_slices.h"

#include <math.h>

/* Returns the index after the last direction of the ring that starts at first. A ring consists of
 * successive directions whose θ differs by less than 0.1° from that of the first direction. */
static int ring_end(const float *theta_deg, int n, int first) {
    int end = first + 1;
    while (end < n && fabsf(theta_deg[end] - theta_deg[first]) < 0.1f)
        end++;
    return end;
}

static gboolean ring_is_even(const float *phi_deg, int first, int end) {
    for (int k = first; k < end; k++) {
        double turn = (phi_deg[k] - phi_deg[first]) / 360.0;
        double off = turn - (double)(k - first) / (end - first);
        if (fabs(off - rint(off)) > 1e-4)
            return FALSE;
    }
    return TRUE;
}

gboolean ring_slices_find(const float *theta_deg, const float *phi_deg, int n,
                          struct ring_slices *ret) {
    ret->n_rings = ret->n_slices = 0;
    for (int first = 0, end; first < n; first = end) {
        end = ring_end(theta_deg, n, first);
        const int ring = ret->n_rings++;
        if (ring == RING_SLICES_MAX || !ring_is_even(phi_deg, first, end) ||
            (ring > 0 && theta_deg[first] < theta_deg[first - 1]))
            return FALSE;
        float *to = ret->rings[ring];
        to[0] = theta_deg[first] * (float)(G_PI / 180.0);
        to[1] = (float)ret->n_slices + 0.5f;
        to[2] = (float)(end - first);
        to[3] = phi_deg[first] / 360.0f;
        ret->n_slices += end - first + 1;
    }
    return TRUE;
}

int ring_slices_direction(const struct ring_slices *rings, int slice) {
    int first = 0;
    for (int k = 0;; k++) {
        const int n = (int)rings->rings[k][2];
        if (slice <= n)
            return first + slice % n;
        slice -= n + 1;
        first += n;
    }
}
