/*
 * Plays the devices of a recording, so that a driver meets what a real device has said.
 *
 * The order of requests decides, not the time. The device sends a message of the recording as soon
 * as all requests before this message have come. If a request differs from the recording, the
 * replay has a difference, and the device says nothing more.
 *
 * Polls, and levels that are sent again and again, depend on the time. They may come more often or
 * less often than in the recording, as long as the answer does not change. If the recording has a
 * new answer to a poll, this poll must come as in the recording.
 *
 * The kinds of buses are replayed in these ways, each bus in its own thread:
 * - serial lines on pseudo-terminals
 * - Modbus over TCP
 * - lamps in the network on the loopback interface
 * - programs by a program that passes its input and output on
 * - USB behind umockdev (testbed.h)
 *
 * The functions belong to one thread.
 */
#pragma once

#include "recorded.h"

typedef struct Replay Replay;

/* Starts the devices. recorded must stay valid as long as the replay. Buses that cannot be
 * replayed, such as those of cameras, are left out. Returns NULL with an error if a device cannot
 * be made.
 *
 * pipe is the path of a Python program that takes the place of a recorded program. It sends its
 * standard input to the socket that its argument names, and writes what it receives from this
 * socket to its standard output. */
Replay *replay_new(const Recorded *recorded, const char *pipe, GError **error);
void replay_free(Replay *replay); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Replay, replay_free)

/* Returns the sections of the recording. "@N" is replaced by the place of the replayed device. The
 * replay owns the text. */
const char *replay_sections(const Replay *replay);

/* Returns whether all requests before this line of the recording have come. G_MAXINT means all
 * requests of the recording. */
gboolean replay_is_at(Replay *replay, int line);

/* Returns the first difference, as "FILE:LINE: expected …, but the program sent …". Returns NULL if
 * there was none. Free it with g_free(). */
char *replay_difference(Replay *replay);

/* Returns the next request that is missing, as "FILE:LINE: expected …, but nothing came". Returns
 * NULL if all requests have come. Free it with g_free(). */
char *replay_missing(Replay *replay);
