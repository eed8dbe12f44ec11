#include "dmx.h"

#include "drivers/lock.h"

#include <arpa/inet.h>
#include <math.h>
#include <string.h>

#define COMMAND_MS 1500 /* deadline of a command */
#define TICK_MS    10   /* period of the timer while a command is under way */
#define LOST_MS    3000 /* silence of the receivers after which they count as lost */
#define WAIT_MS    5    /* pause between two checks of a function that waits */

struct command {
    int index; /* -1: all lamps */
    gboolean on;
    int n_sent;               /* number of times that the levels were sent, up to DMX_SENDS */
    gint64 begun_us, sent_us; /* sent_us: when the levels were last sent */
    gboolean ended;           /* the result is known, but was not delivered yet */
    gboolean waited_for;      /* a function waits for the command, and takes the result itself */
    GError *error;
};

enum dmx_state { LAMP_DARK, LAMP_LIT, LAMP_UNKNOWN };

static void command_free(gpointer data) {
    struct command *command = data;
    g_clear_error(&command->error);
    g_free(command);
}

gboolean dmx_address(const char *text, guint32 *ret) {
    struct in_addr address = {0};
    if (*text && inet_pton(AF_INET, text, &address) != 1)
        return FALSE;
    *ret = ntohl(address.s_addr);
    return TRUE;
}

static int n_level_channels(const struct dmx *dmx) {
    return dmx->bits / 8;
}

static int n_channels(const struct dmx *dmx) {
    return dmx->channels ? dmx->channels
                         : n_level_channels(dmx) + dmx->n_same + dmx->other_values.n;
}

/* Returns the position of the universe of a lamp. *ret_channel is the first channel of the lamp,
 * from 0. All channels of a lamp are in one universe. */
static int position(const struct dmx *dmx, int index, int *ret_channel) {
    const int width = MIN(n_channels(dmx), DMX_CHANNELS); /* dmx_check() refuses more */
    const int n_first = (DMX_CHANNELS - dmx->start + 1) / width;
    const int n_each = DMX_CHANNELS / width;
    if (index < n_first) {
        *ret_channel = dmx->start - 1 + index * width;
        return 0;
    }
    *ret_channel = (index - n_first) % n_each * width;
    return 1 + (index - n_first) / n_each;
}

int dmx_universe(const struct dmx *dmx, int i) {
    return dmx->universe + i;
}

int dmx_count_universes(const struct dmx *dmx) {
    int channel;
    return 1 + position(dmx, dmx->n - 1, &channel);
}

void dmx_check(const struct dmx *dmx, const struct dmx_protocol *protocol,
               const struct config_section *section, Mistakes *mistakes) {
    const int most = dmx->bits == 16 ? 65535 : 255;
    const int least = n_level_channels(dmx) + dmx->other_values.n;
    guint32 unused;
    if (dmx->universe < protocol->min_universe)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "universe",
                       "%d is out of range: %d to %d", dmx->universe, protocol->min_universe,
                       protocol->max_universe);
    if (dmx->bits != 8 && dmx->bits != 16)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "bits", "%d is neither 8 nor 16",
                       dmx->bits);
    else if (n_channels(dmx) < least)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "channels",
                       "%d is too few: brightness and other_values need %d channels", dmx->channels,
                       least);
    else if (n_channels(dmx) > DMX_CHANNELS)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "other_values",
                       "a lamp has %d channels, but a universe has only %d", n_channels(dmx),
                       DMX_CHANNELS);
    else if (dmx->start - 1 + n_channels(dmx) > DMX_CHANNELS)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "start",
                       "lamp 0 does not fit: its %d channels from channel %d on would end after "
                       "channel %d, the last of a universe; give a lower start",
                       n_channels(dmx), dmx->start, DMX_CHANNELS);
    else if (dmx->universe + dmx_count_universes(dmx) - 1 > protocol->max_universe)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "universe",
                       "%d lamps need %d universes from this one on, but the last universe of %s "
                       "is %d; give a lower universe or fewer lamps",
                       dmx->n, dmx_count_universes(dmx), protocol->name, protocol->max_universe);
    if (dmx->levels.n > 1 && dmx->levels.n != dmx->n)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "levels",
                       "has %d numbers for %d lamps; give one number or one for each lamp",
                       dmx->levels.n, dmx->n);
    for (int i = 0; i < dmx->levels.n; i++)
        if (dmx->levels.values[i] > most) {
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "levels",
                           "%g is out of range: 1 to %d with bits = %d", dmx->levels.values[i],
                           most, dmx->bits);
            break;
        }
    if (!dmx_address(dmx->local_address, &unused))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "local_address",
                       "“%s” is not an IPv4 address such as 10.0.0.1", dmx->local_address);
}

void dmx_needs(const struct dmx *dmx, const struct dmx_protocol *protocol, GPtrArray *to) {
    const int n = dmx_count_universes(dmx);
    for (int i = 0; i < n; i++) {
        char *unit = protocol->unit(dmx, i);
        if (unit)
            g_ptr_array_add(to, unit);
    }
}

static int level_of(const struct dmx *dmx, int index) {
    if (dmx->levels.n == 0)
        return dmx->bits == 16 ? 65535 : 255;
    return (int)lround(dmx->levels.values[dmx->levels.n > 1 ? index : 0]);
}

/* Puts the channels of a lamp into the frame of its universe. */
static void put(struct dmx *dmx, int index, gboolean on) {
    int channel;
    guint8 *frame = dmx->frames[position(dmx, index, &channel)];
    const int level = on ? level_of(dmx, index) : 0;
    if (dmx->bits == 16)
        frame[channel++] = (guint8)(level >> 8);
    for (int i = 0; i <= dmx->n_same; i++)
        frame[channel++] = level & 0xff;
    for (int i = 0; i < dmx->other_values.n; i++)
        frame[channel++] = (guint8)(on ? lround(dmx->other_values.values[i]) : 0);
}

gboolean dmx_is_dark(const struct dmx *dmx) {
    for (int i = 0; i < dmx->n_universes; i++)
        for (int k = 0; k < DMX_CHANNELS; k++)
            if (dmx->frames[i][k])
                return FALSE;
    return TRUE;
}

static gboolean covers(const struct command *command, int i) {
    return command->index < 0 || command->index == i;
}

static void set_states(struct dmx *dmx, const struct command *command, enum dmx_state state) {
    for (int i = 0; i < dmx->n; i++)
        if (covers(command, i))
            dmx->states[i] = state;
}

static gboolean any_lit(const struct dmx *dmx) {
    return memchr(dmx->states, LAMP_LIT, (gsize)dmx->n) != NULL;
}

static gboolean any_waits(const struct dmx *dmx) {
    for (const GList *l = dmx->commands.head; l; l = l->next)
        if (!((const struct command *)l->data)->ended)
            return TRUE;
    return FALSE;
}

/* Returns whether no later command than this one covers lamp i. */
static gboolean is_last(const struct dmx *dmx, const struct command *command, int i) {
    for (const GList *l = dmx->commands.tail; l; l = l->prev)
        if (covers(l->data, i))
            return l->data == command;
    return FALSE;
}

/* Notes the result of a command. Takes ownership of error. */
static void end(struct dmx *dmx, struct command *command, GError *error) {
    command->ended = TRUE;
    command->error = error;
    for (int i = 0; i < dmx->n; i++)
        if (covers(command, i) && is_last(dmx, command, i))
            dmx->states[i] = error ? LAMP_UNKNOWN : command->on ? LAMP_LIT : LAMP_DARK;
}

static void lose(struct dmx *dmx, GError *error) {
    memset(dmx->states, LAMP_UNKNOWN, (gsize)dmx->n);
    if (dmx->lost)
        g_error_free(error);
    else
        dmx->lost = error;
}

/* Ends all commands and reports lit lamps as lost, because the receivers do not obey. */
static void fail_all(struct dmx *dmx, const GError *error) {
    const gboolean lit = any_lit(dmx);
    for (GList *l = dmx->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (!command->ended)
            end(dmx, command, g_error_copy(error));
    }
    if (lit)
        lose(dmx, g_error_copy(error));
}

static void send_frames(struct dmx *dmx) {
    const gint64 now = clock_now_us(dmx->bank->device.clock);
    g_autoptr(GError) error = NULL;
    for (int i = 0; i < dmx->n_universes; i++) {
        GError *failed = NULL;
        if (!dmx->protocol->send(dmx, i, &failed) && !error)
            error = failed;
        else
            g_clear_error(&failed);
    }
    dmx->sent_us = now;
    dmx->n_burst = MAX(dmx->n_burst - 1, 0);
    if (error) {
        error_details_add_subject(&error, dmx->bank->device.who);
        fail_all(dmx, error);
        return;
    }
    for (GList *l = dmx->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (command->n_sent < DMX_SENDS) {
            command->n_sent++;
            command->sent_us = now;
        }
    }
}

static gboolean is_sent(const struct command *command) {
    return command->n_sent >= DMX_SENDS;
}

/* Ends the commands that are confirmed or refused. If one is overdue, ends all of them. Reports lit
 * lamps as lost if the receivers have a fault or are silent. */
static void check_commands(struct dmx *dmx) {
    const gint64 now = clock_now_us(dmx->bank->device.clock);
    const gint64 alive_us = dmx->protocol->alive_us(dmx);
    g_autoptr(GError) fault = dmx->protocol->fault(dmx);
    gboolean silent = FALSE;
    for (GList *l = dmx->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (command->ended)
            continue;
        if (is_sent(command) && alive_us >= command->sent_us &&
            now >= command->sent_us + DMX_GAP_MS * 1000)
            end(dmx, command, fault ? g_error_copy(fault) : NULL);
        else
            silent |= now >= command->begun_us + COMMAND_MS * 1000;
    }
    g_autoptr(GError) silence = silent ? dmx->protocol->silence(dmx) : NULL;
    if (silence)
        fail_all(dmx, silence);
    if (any_lit(dmx) && fault)
        lose(dmx, g_error_copy(fault));
    else if (any_lit(dmx) && now >= alive_us + LOST_MS * 1000)
        lose(dmx, dmx->protocol->silence(dmx));
}

/* Sends what is due and takes what has arrived. Reports nothing. */
static void step(struct dmx *dmx) {
    const gint64 since = clock_now_us(dmx->bank->device.clock) - dmx->sent_us;
    gboolean urgent = FALSE;
    if (since >= (dmx->n_burst > 0 ? DMX_GAP_MS : DMX_KEEP_ALIVE_MS) * (gint64)1000)
        send_frames(dmx);
    for (const GList *l = dmx->commands.head; l; l = l->next) {
        const struct command *command = l->data;
        urgent |=
            !command->ended && is_sent(command) && dmx->protocol->alive_us(dmx) < command->sent_us;
    }
    dmx->protocol->look(dmx, urgent, any_lit(dmx));
    check_commands(dmx);
}

static void on_timer(gpointer data);

static void wake(struct dmx *dmx, int ms) {
    Clock *clock = dmx->bank->device.clock;
    clock_cancel(clock, &dmx->timer);
    dmx->timer = clock_call_in(clock, ms * (gint64)1000, on_timer, dmx);
}

void dmx_wake(struct dmx *dmx) {
    wake(dmx, 0);
}

/* Reports one result. A caller does nothing afterwards, because the listener may close the bank. */
static void deliver(struct dmx *dmx) {
    LampBank *bank = dmx->bank;
    for (GList *l = dmx->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (!command->ended || command->waited_for)
            continue;
        g_queue_delete_link(&dmx->commands, l);
        const int index = command->index;
        const gboolean on = command->on;
        GError *error = g_steal_pointer(&command->error);
        command_free(command);
        wake(dmx, 0);
        lamps_report(bank, index, on, error);
        return;
    }
    if (dmx->lost)
        lamps_lost(bank, g_steal_pointer(&dmx->lost));
}

static void on_timer(gpointer data) {
    struct dmx *dmx = data;
    dmx->timer = 0;
    step(dmx);
    const gboolean busy = any_waits(dmx) || dmx->n_burst > 0 || dmx->lost;
    wake(dmx, busy ? TICK_MS : 10 * TICK_MS);
    deliver(dmx);
}

static struct command *add(struct dmx *dmx, int index, gboolean on) {
    struct command *command = g_new0(struct command, 1);
    *command = (struct command){
        .index = index, .on = on, .begun_us = clock_now_us(dmx->bank->device.clock)};
    g_queue_push_tail(&dmx->commands, command);
    set_states(dmx, command, LAMP_UNKNOWN);
    for (int i = 0; i < dmx->n; i++)
        if (covers(command, i))
            put(dmx, i, on);
    dmx->n_burst = DMX_SENDS;
    return command;
}

/* Ends each "on" that an "off" of the same lamp has replaced before it was confirmed. Its levels
 * are not sent any more. */
static void overtake(struct dmx *dmx, int index) {
    for (GList *l = dmx->commands.head; l; l = l->next) {
        struct command *command = l->data;
        if (!command->ended && command->on && (index < 0 || command->index == index))
            end(dmx, command,
                device_error_new(
                    DEVICE_ERROR_BUSY, dmx->bank->device.who,
                    "“on” of lamp %d was given up, because “off” came before the lamp was on",
                    command->index));
    }
}

gboolean dmx_set(struct dmx *dmx, int index, gboolean on, GError **error) {
    if (!on)
        overtake(dmx, index);
    add(dmx, index, on);
    wake(dmx, 0);
    return TRUE;
}

/* Sends "off" and waits for its end, without the main loop. */
static gboolean ask_off(struct dmx *dmx, int wait_ms, GError **error) {
    Clock *clock = dmx->bank->device.clock;
    const gint64 until_us = clock_now_us(clock) + wait_ms * (gint64)1000;
    struct command *command = add(dmx, -1, FALSE);
    command->waited_for = TRUE;
    while (!command->ended) {
        command->begun_us = clock_now_us(clock); /* until_us is the deadline */
        step(dmx);
        if (!command->ended && clock_now_us(clock) >= until_us)
            end(dmx, command, dmx->protocol->silence(dmx));
        g_usleep(command->ended ? 0 : WAIT_MS * 1000);
    }
    g_queue_remove(&dmx->commands, command);
    const gboolean ok = !command->error;
    if (!ok)
        g_propagate_error(error, g_steal_pointer(&command->error));
    command_free(command);
    return ok;
}

static void release(gpointer lock) {
    lock_release(lock);
}

void dmx_init(struct dmx *dmx, const struct dmx_protocol *protocol, LampBank *bank) {
    dmx->protocol = protocol;
    dmx->bank = bank;
    dmx->n_universes = dmx_count_universes(dmx);
    dmx->frames = g_malloc0((gsize)dmx->n_universes * DMX_CHANNELS);
    dmx->states = g_new0(guint8, dmx->n);
    dmx->locks = g_ptr_array_new_with_free_func(release);
    dmx->sent_us = clock_now_us(bank->device.clock) - G_USEC_PER_SEC;
    g_queue_init(&dmx->commands);
}

gboolean dmx_lock(struct dmx *dmx, GError **error) {
    g_autoptr(GPtrArray) units = g_ptr_array_new_with_free_func(g_free);
    dmx_needs(dmx, dmx->protocol, units);
    for (guint i = 0; i < units->len; i++) {
        const char *unit = units->pdata[i];
        Lock *lock = lock_take(unit, LOCK_SHARED, unit, error);
        if (!lock)
            return FALSE;
        g_ptr_array_add(dmx->locks, lock);
    }
    return TRUE;
}

gboolean dmx_start(struct dmx *dmx, int wait_ms, GError **error) {
    if (!ask_off(dmx, wait_ms, error))
        return FALSE;
    dmx->bank->n = dmx->n;
    dmx->bank->warm_up_s = dmx->warm_up_s;
    wake(dmx, 0);
    return TRUE;
}

void dmx_stop(struct dmx *dmx, int wait_ms) {
    g_queue_clear_full(&dmx->commands, command_free);
    ask_off(dmx, wait_ms, NULL);
}

void dmx_leave(struct dmx *dmx) {
    clock_cancel(dmx->bank->device.clock, &dmx->timer);
    g_queue_clear_full(&dmx->commands, command_free);
    g_clear_error(&dmx->lost);
    g_clear_pointer(&dmx->locks, g_ptr_array_unref);
    g_clear_pointer(&dmx->frames, g_free);
    g_clear_pointer(&dmx->states, g_free);
}
