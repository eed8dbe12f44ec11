/*
 * A clock is an object: the real one, or a virtual one whose time jumps to the next event.
 *
 * Everything that waits (deadlines, settling, warm-up, a simulated exposure) asks its Clock, so
 * that a session of ten hours can be simulated in the time its frames take to render.
 *
 * Times are microseconds since an arbitrary start, never stepped back. All functions belong to the
 * main loop's thread, except those that hold and release the clock, which any thread may call.
 */
#pragma once

#include <glib.h>

typedef struct Clock Clock;
typedef void (*ClockFunc)(gpointer data);

/* Real time: callbacks come from timers of the default main context. */
Clock *clock_new_real(void);

/*
 * Virtual time: when the default main context has nothing else to do and nobody holds the clock,
 * time jumps to the next call and makes it. Calls due at the same time are made in the order in
 * which they were asked for.
 */
Clock *clock_new_virtual(void);

Clock *clock_ref(Clock *clock);
void clock_unref(Clock *clock); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Clock, clock_unref)

gboolean clock_is_virtual(const Clock *clock);
gint64 clock_now_us(const Clock *clock);

/* Calls func once, at a time or after a delay; a time that has passed means as soon as possible.
 * Returns an id, never 0. */
guint clock_call_at(Clock *clock, gint64 at_us, ClockFunc func, gpointer data);
guint clock_call_in(Clock *clock, gint64 delay_us, ClockFunc func, gpointer data);

/* Cancels a call that has not been made yet. *id is set to 0; an id of 0 is ignored. A callback
 * must set the variable that holds its id to 0, because cancelling a call that was made is a
 * programming error. Ids are not used twice. */
void clock_cancel(Clock *clock, guint *id);

/* While the clock is held, virtual time stands still: another thread does work that takes no
 * simulated time (it renders a frame or writes a file). Holds nest. No effect on the real clock. */
void clock_hold(Clock *clock);
void clock_release(Clock *clock);

/* Asks threads that work beside the main loop to hold a virtual clock while they work, which they
 * otherwise do not do. Runs with the same devices then have the same events in the same order, and
 * no work overlaps. For simulations that are replayed; to be called before such threads work. */
void clock_set_lockstep(Clock *clock);
gboolean clock_is_lockstep(const Clock *clock);
