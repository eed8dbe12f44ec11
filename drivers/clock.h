/*
 * A clock is an object: either the real clock, or a virtual one whose time jumps to the next event.
 *
 * Everything that waits (deadlines, settling, warm-up, a simulated exposure) uses its Clock. A
 * session of ten hours can therefore be simulated in the time that its frames take to render.
 *
 * Times are microseconds since an arbitrary start and never decrease. All functions belong to the
 * main loop's thread, except clock_hold() and clock_release(), which any thread may call.
 */
#pragma once

#include <glib.h>

typedef struct Clock Clock;
typedef void (*ClockFunc)(gpointer data);

/* Makes a clock that runs in real time. Its callbacks come from timers of the default main
 * context. */
Clock *clock_new_real(void);

/*
 * Makes a clock with virtual time. When the default main context has nothing else to do and nobody
 * holds the clock, time jumps to the next call that was requested, and the clock makes that call.
 * Calls that are due at the same time are made in the order in which they were requested.
 */
Clock *clock_new_virtual(void);

Clock *clock_ref(Clock *clock);
void clock_unref(Clock *clock); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Clock, clock_unref)

gboolean clock_is_virtual(const Clock *clock);
gint64 clock_now_us(const Clock *clock);

/* Both functions call `func` once from the main loop, at a time or after a delay. If that time has
 * already passed, `func` is called as soon as possible. The functions return an id for
 * clock_cancel(). The id is never 0. */
guint clock_call_at(Clock *clock, gint64 at_us, ClockFunc func, gpointer data);
guint clock_call_in(Clock *clock, gint64 delay_us, ClockFunc func, gpointer data);

/* Cancels a call that has not been made yet, and sets *id to 0. An id of 0 is ignored. A callback
 * must set the variable that holds its id to 0, because it is a programming error to cancel a call
 * that was made. Ids are not used twice. */
void clock_cancel(Clock *clock, guint *id);

/* While the clock is held, virtual time stands still. Another thread holds the clock while it does
 * work that takes no simulated time, such as rendering a frame or writing a file. Several threads
 * may hold the clock at once: it is held until each clock_hold() was followed by a clock_release().
 * Both functions have no effect on the real clock. */
void clock_hold(Clock *clock);
void clock_release(Clock *clock);

/* For tests: switches on lockstep. In lockstep, threads that work in parallel to the main loop hold
 * a virtual clock while they work. Without lockstep they do not hold the clock. In lockstep, runs
 * with the same devices have the same events in the same order, and no work of different threads
 * overlaps. A simulation that is to be repeated exactly needs this. Call the function before such
 * threads begin to work. */
void clock_set_lockstep(Clock *clock);
gboolean clock_is_lockstep(const Clock *clock);
