#include "heard.h"

void heard_clear(struct heard *heard) {
    g_clear_error(&heard->error);
    g_clear_pointer(&heard->frame, frame_unref);
}

void heard_begin(struct heard *heard, gconstpointer unused) {
    heard->clock = clock_new_virtual();
}

void heard_end(struct heard *heard, gconstpointer unused) {
    heard_clear(heard);
    clock_unref(heard->clock);
}

void heard_event(struct heard *heard, int event, const GError *error) {
    heard->n++;
    heard->event = event;
    heard->at_us = clock_now_us(heard->clock);
    g_clear_error(&heard->error);
    heard->error = error ? g_error_copy(error) : NULL;
}

void heard_next(struct heard *heard, int event) {
    conformance_wait(heard->clock, &heard->n, 1, 1000);
    g_assert_cmpint(heard->n, ==, 1);
    g_assert_cmpint(heard->event, ==, event);
    heard->n = 0;
}
