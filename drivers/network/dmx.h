/*
 * Lamps on channels of DMX512, whatever carries the channels. Art-Net and sACN share this file.
 *
 * The levels of all channels are a state that is sent again and again: DMX_SENDS times in fast
 * succession after each change, and DMX_KEEP_ALIVE_MS apart otherwise. All 512 channels of each
 * universe are sent, and channels without a lamp are 0. A command ends when its levels were sent
 * DMX_SENDS times, and the protocol says that the receiver was alive after that.
 *
 * Only the main thread may call the functions.
 */
#pragma once

#include "drivers/lamps.h"

#define DMX_CHANNELS  512
#define DMX_MAX_LAMPS 1024
#define DMX_SENDS     3
/* time from one frame to the next; a frame takes 22.7 ms on the cable */
#define DMX_GAP_MS        25
#define DMX_KEEP_ALIVE_MS 900 /* Art-Net 4 and E1.31 demand 800 to 1000 ms */

struct dmx;

struct dmx_protocol {
    const char *name; /* "Art-Net" */
    int min_universe, max_universe;
    /* Returns the name of the resource that the i-th universe occupies, for driver_info.needs and
     * for the lock. Returns NULL if an earlier universe occupies the same resource. The caller
     * frees the name with g_free(). */
    char *(*unit)(const struct dmx *dmx, int i);
    /* Sends the levels of the i-th universe. */
    gboolean (*send)(struct dmx *dmx, int i, GError **error);
    /* Takes the packets that have arrived, and sends what the protocol needs besides levels. urgent
     * is TRUE if a command waits until alive_us() returns a later time. lit is TRUE if a lamp is
     * lit. */
    void (*look)(struct dmx *dmx, gboolean urgent, gboolean lit);
    /* Returns the last time at which the receivers are known to have been alive. Returns G_MININT64
     * if nothing was ever heard from them. */
    gint64 (*alive_us)(const struct dmx *dmx);
    /* Returns an error if, at the time alive_us(), the receivers did not obey. Otherwise returns
     * NULL. */
    GError *(*fault)(const struct dmx *dmx);
    /* Returns the error of a command that was not confirmed in time. */
    GError *(*silence)(const struct dmx *dmx);
};

/* The first member of the private struct of a driver. */
struct dmx {
    /* options */
    char *address, *local_address;
    int universe, start, n, channels, bits;
    struct option_doubles levels, other_values;
    /* Number of channels after the brightness that get the same value as the brightness. The
     * driver sets it. */
    int n_same;
    double warm_up_s;

    const struct dmx_protocol *protocol;
    LampBank *bank;
    int n_universes;
    guint8 (*frames)[DMX_CHANNELS];
    GPtrArray *locks; /* of Lock */
    GQueue commands;  /* of struct command, in order */
    guint8 *states;   /* state of each lamp: enum dmx_state */
    int n_burst;      /* frames that are still to be sent in fast succession */
    gint64 sent_us;   /* time when the frames were last sent */
    guint timer;
    GError *lost; /* error that is soon given to lamps_lost(); NULL if there is none */
};

/* Rows of the option table that the drivers share. */
#define DMX_FIELD(name) G_STRUCT_OFFSET(struct dmx, name)
/* clang-format off */
#define DMX_OPTIONS \
    {"universe", OPTION_INT, NULL, 0, 63999, "1", NULL, DMX_FIELD(universe), \
     "Universe of lamp 0. Lamps that do not fit are in the universes after it"}, \
    {"n", OPTION_INT, NULL, 1, DMX_MAX_LAMPS, NULL, NULL, DMX_FIELD(n), "Number of lamps"}, \
    {"start", OPTION_INT, NULL, 1, DMX_CHANNELS, "1", NULL, DMX_FIELD(start), \
     "First channel of lamp 0. In further universes the first lamp has channel 1"}, \
    {"channels", OPTION_INT, NULL, 0, DMX_CHANNELS, "0", NULL, DMX_FIELD(channels), \
     "Number of channels that each lamp occupies. 0: those of its brightness and other_values"}, \
    {"bits", OPTION_INT, NULL, 8, 16, "8", NULL, DMX_FIELD(bits), \
     "8: the first channel of a lamp is its brightness. 16: the first two channels are, with the " \
     "coarse channel first"}, \
    {"levels", OPTION_DOUBLES, NULL, 1, 65535, "", NULL, DMX_FIELD(levels), \
     "Brightness of the lamps that are on: one number for all lamps, or one for each lamp. " \
     "Without it, lamps have the full brightness of 255 or 65535"}, \
    {"other_values", OPTION_DOUBLES, NULL, 0, 255, "", NULL, DMX_FIELD(other_values), \
     "Values of the channels after the brightness of each lamp that is on, such as its colour. " \
     "They are 0 while the lamp is off"}, \
    {"local_address", OPTION_STRING, .fallback = "", .offset = DMX_FIELD(local_address), \
     .help = "Address of this computer in the network of the lamps. Needed if the computer has " \
             "several networks"}, \
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, DMX_FIELD(warm_up_s), \
     "Time from switching on until the output is stable"}
/* clang-format on */

/* For driver_info.check: adds the mistakes in the shared options. */
void dmx_check(const struct dmx *dmx, const struct dmx_protocol *protocol,
               const struct config_section *section, Mistakes *mistakes);

/* For driver_info.needs. */
void dmx_needs(const struct dmx *dmx, const struct dmx_protocol *protocol, GPtrArray *to);

/* Reads an IPv4 address such as 10.0.0.7. The text "" is 0.0.0.0. Returns FALSE if the text is not
 * an address. */
gboolean dmx_address(const char *text, guint32 *ret);

/* dmx_universe() returns the universe at position i. dmx_count_universes() returns the number of
 * universes that the n lamps need. */
int dmx_universe(const struct dmx *dmx, int i);
int dmx_count_universes(const struct dmx *dmx);

/* Returns whether all levels are 0. */
gboolean dmx_is_dark(const struct dmx *dmx);

/* Prepares the state. The driver then opens its socket and calls dmx_start(). If the socket cannot
 * be opened, or if dmx_start() fails, the driver calls dmx_leave(). */
void dmx_init(struct dmx *dmx, const struct dmx_protocol *protocol, LampBank *bank);
/* Locks each resource that dmx_protocol.unit() names for the universes. */
gboolean dmx_lock(struct dmx *dmx, GError **error);
/* Sends "off" and waits for its end, for at most wait_ms. Fills the bank. */
gboolean dmx_start(struct dmx *dmx, int wait_ms, GError **error);
/* Sends "off" and waits for its end, for at most wait_ms, before the driver closes its socket. */
void dmx_stop(struct dmx *dmx, int wait_ms);
void dmx_leave(struct dmx *dmx);

/* For lamps_driver.set. */
gboolean dmx_set(struct dmx *dmx, int index, gboolean on, GError **error);
/* For the driver: call it when a packet or another answer has arrived. */
void dmx_wake(struct dmx *dmx);
