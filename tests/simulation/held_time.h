/*
 * Time and threads of a life that has the bus. GDBus reads and writes its sockets in a thread of
 * its own; poll(), defined in the program itself, keeps it in step: the main loop looks for what is
 * ready only when that thread waits for its sockets, and none of these has anything for it. What is
 * given to other threads is done before the main loop goes on. Time
 * stands still until the main loop would sleep, and then jumps to where it would wake up. What
 * happens, and in which order, then follows from what the life's clients send, and when.
 */
#pragma once

#include "disk.h"

/* In the main loop's thread. From now on time is disk->ended_us, and the disk must be active
 * (disk_calls.c tells the time). */
void held_time_begin(struct disk *disk);

/* The main loop sleeps to this time at most, in disk->ended_us. */
void held_time_set_limit(gint64 limit_us);

/* There is a connection, and so a thread of GDBus, from now on. */
void held_time_set_bus(void);

/* Waits until that thread has handled all that was sent. */
void held_time_wait(void);

/* Called when the main loop's thread waits for something that only this function can send. NULL: no
 * more. */
void held_time_set_feeder(void (*func)(gpointer data), gpointer data);
