/* A controller in C on zenoh-pico and nanopb, as on a microcontroller.
 *
 *     pico_controller NAME LISTEN CONNECT [controller.json5]
 *
 * The file of `hertzloop node keys` is for TLS. Protocol: docs/reference/wire.md; build:
 * docs/how-to/microcontroller.md. Law: the force of slope_threshold, from the scene's keys kappa,
 * v_thr_m_s and latency_us, for an ideal actuator. It ends with 0 after a whole run, else with 1.
 */
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <zenoh-pico.h>

#include "messages.pb.h"
#include "pb_decode.h"
#include "pb_encode.h"

#ifndef MESSAGE_BYTES
#define MESSAGE_BYTES 2048 /* of the largest message: --max-exchange-steps 200 of the plant keeps to it */
#endif
#define SAMPLES (MESSAGE_BYTES / 4) /* in a block at most */
#define FORCES (SAMPLES + 64)       /* of a block of answers, with those of the latency */
#define HISTORY 1024                /* samples that the law looks back: a power of two */
#define WAIT_S 60                   /* for the others to begin */
#define TIMEOUT_S 5                 /* for a message in the run */

static void give_up(const char *format, ...) {
    va_list given;
    va_start(given, format);
    vfprintf(stderr, format, given);
    va_end(given);
    fputc('\n', stderr);
    _Exit(1); /* the session's threads may wait for a peer */
}

/* --- What has come, in its order: the reading thread of zenoh-pico puts, the main thread takes --- */

enum { HELLO, DAQ, END, LEFT };
#define SLOTS 4 /* the plant waits for each answer; a full inbox makes the link wait */
static struct {
    int kind;
    size_t size;
    uint8_t bytes[MESSAGE_BYTES];
} inbox[SLOTS];
static unsigned put, taken;
static int plants, recorders, complete, too_large;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t news = PTHREAD_COND_INITIALIZER;

static void on_message(z_loaned_sample_t *sample, void *kind) {
    const z_loaned_bytes_t *payload = z_sample_payload(sample);
    size_t size = z_bytes_len(payload);
    pthread_mutex_lock(&lock);
    while (put - taken == SLOTS) pthread_cond_wait(&news, &lock);
    if (size > MESSAGE_BYTES) {
        too_large = (int)size;
        size = 0;
    }
    z_bytes_reader_t reader = z_bytes_get_reader(payload);
    z_bytes_reader_read(&reader, inbox[put % SLOTS].bytes, size);
    inbox[put % SLOTS].kind = (int)(intptr_t)kind;
    inbox[put++ % SLOTS].size = size;
    pthread_cond_broadcast(&news);
    pthread_mutex_unlock(&lock);
}

static void on_token(z_loaned_sample_t *sample, void *unused) {
    z_view_string_t key;
    (void)unused;
    z_keyexpr_as_view_string(z_sample_keyexpr(sample), &key);
    char text[256] = "";
    size_t length = z_string_len(z_view_string_loan(&key));
    memcpy(text, z_string_data(z_view_string_loan(&key)), length < 255 ? length : 255);
    int by = z_sample_kind(sample) == Z_SAMPLE_KIND_PUT ? 1 : -1;
    pthread_mutex_lock(&lock);
    if (strstr(text, "/alive/plant/")) plants += by;
    if (strstr(text, "/alive/recorder/")) recorders += by;
    if (strstr(text, "/complete/recorder") && by > 0) complete = 1;
    pthread_cond_broadcast(&news);
    pthread_mutex_unlock(&lock);
}

/* Wait until `there` holds, with the lock; 0 when the time is over. */
static int wait_until(int (*there)(void), int seconds) {
    struct timespec end;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_sec += seconds;
    while (!there())
        if (pthread_cond_timedwait(&news, &lock, &end)) return there();
    return 1;
}

static int both_there(void) { return plants > 0 && recorders > 0; }
static int something(void) { return put != taken || ((!both_there()) && !complete); }
static int recorder_gone(void) { return recorders <= 0; }

/* --- Publishing: one publisher a stream --- */

static z_owned_publisher_t force_stream, end_stream;
static uint8_t outbox[8 * FORCES + MESSAGE_BYTES];

static void publish(z_owned_publisher_t *stream, size_t size) {
    z_owned_bytes_t payload;
    z_bytes_copy_from_buf(&payload, outbox, size);
    if (z_publisher_put(z_publisher_loan(stream), z_bytes_move(&payload), NULL) < 0)
        give_up("a message could not be sent");
}

/* --- Hello, law, answers --- */

static hertzloop_Hello hello;
static char scene[MESSAGE_BYTES];
static double gaps[HISTORY], values[SAMPLES], forces[FORCES];
static int64_t samples, first_step, start_sample, delay;
static uint64_t messages, heard;
static int every, latency, mode; /* mode: 0 idle, 1 watching, 2 acting */
static double gain, v_thr, sample_s;
static size_t count; /* of forces or values in their array */

static double key(const char *name) {
    char line[64];
    snprintf(line, sizeof line, "\n%s = ", name);
    const char *found = strstr(scene, line);
    if (!found) give_up("the scene has no key %s", name);
    return atof(found + strlen(line));
}

static bool read_scene(pb_istream_t *stream, const pb_field_t *field, void **arg) {
    (void)field, (void)arg;
    size_t size = stream->bytes_left;
    if (size >= sizeof scene) return false;
    scene[size] = 0;
    return pb_read(stream, (pb_byte_t *)scene, size);
}

static void hear_hello(const uint8_t *bytes, size_t size) {
    pb_istream_t stream = pb_istream_from_buffer(bytes, size);
    hello.scene_toml.funcs.decode = read_scene;
    if (!pb_decode(&stream, hertzloop_Hello_fields, &hello)) give_up("malformed hello");
    every = (int)key("every_steps");
    latency = (int)lround(key("latency_us") * 1000.0 / hello.step_ns);
    gain = key("kappa") * hello.stiffness;
    v_thr = key("v_thr_m_s");
    sample_s = every * (hello.step_ns * 1e-9);
    for (count = 0; count < (size_t)(1 + latency); count++) forces[count] = 0.0;
}

/* Force for the next sample of the gap: kappa s p^1.5 of the penetration p a delay ago, from when
 * the slope of the gap is above v_thr. */
static double command(double gap) {
    int touches = gap <= 0.0;
    double before = samples ? gaps[(samples - 1) % HISTORY] : 0.0;
    gaps[samples % HISTORY] = gap;
    if (touches && (!samples || before > 0.0)) start_sample = samples;
    if (mode != 2) mode = touches;
    if (mode == 1 && samples && (gap - before) / sample_s > v_thr) {
        mode = 2;
        delay = samples - start_sample;
    }
    samples++;
    if (mode != 2) return 0.0;
    if (delay >= HISTORY) give_up("the contact is too long for the history");
    double earlier = gaps[(samples - 1 - delay) % HISTORY];
    if (earlier > 0.0) {
        mode = touches;
        return 0.0;
    }
    return gain * -earlier * sqrt(-earlier);
}

static bool read_values(pb_istream_t *stream, const pb_field_t *field, void **arg) {
    const hertzloop_DaqBlock *block = *arg;
    (void)field;
    while (stream->bytes_left) {
        if (count == SAMPLES) return false;
        if (field->tag == hertzloop_DaqBlock_value_tag) {
            if (!pb_decode_fixed64(stream, &values[count])) return false;
        } else {
            int32_t code;
            if (!pb_decode_fixed32(stream, &code)) return false;
            values[count] = block->offset + block->scale * code;
        }
        count++;
    }
    return true;
}

static bool write_forces(pb_ostream_t *stream, const pb_field_t *field, void *const *arg) {
    (void)arg;
    if (!count) return true;
    if (!pb_encode_tag(stream, PB_WT_STRING, field->tag) || !pb_encode_varint(stream, 8 * count))
        return false;
    for (size_t i = 0; i < count; i++)
        if (!pb_encode_fixed64(stream, &forces[i])) return false;
    return true;
}

static bool write_text(pb_ostream_t *stream, const pb_field_t *field, void *const *arg) {
    const char *text = *arg;
    return pb_encode_tag_for_field(stream, field) &&
           pb_encode_string(stream, (const pb_byte_t *)text, strlen(text));
}

static bool write_counts(pb_ostream_t *stream, const pb_field_t *field, void *const *arg) {
    (void)arg;
    hertzloop_StreamCount sent = hertzloop_StreamCount_init_zero;
    sent.messages = messages, sent.samples = (uint64_t)first_step;
    sent.stream.funcs.encode = write_text, sent.stream.arg = "force";
    return pb_encode_tag_for_field(stream, field) &&
           pb_encode_submessage(stream, hertzloop_StreamCount_fields, &sent);
}

static void say_end(const char *fault) {
    static int said;
    if (said++) return;
    hertzloop_RunEnd end = hertzloop_RunEnd_init_zero;
    pb_ostream_t stream = pb_ostream_from_buffer(outbox, sizeof outbox);
    end.run_id = hello.run_id;
    end.role.funcs.encode = end.fault.funcs.encode = write_text;
    end.role.arg = "controller", end.fault.arg = (void *)fault;
    end.count.funcs.encode = write_counts;
    end.has_report = true;
    end.report.law.funcs.encode = write_text;
    end.report.law.arg = "slope threshold on zenoh-pico 1.0";
    if (!pb_encode(&stream, hertzloop_RunEnd_fields, &end)) give_up("the end is too long");
    publish(&end_stream, stream.bytes_written);
}

static void hear_daq(const uint8_t *bytes, size_t size) {
    hertzloop_DaqBlock block = hertzloop_DaqBlock_init_zero;
    pb_istream_t stream = pb_istream_from_buffer(bytes, size);
    size_t known = count, steps = (size_t)((int64_t)hello.steps - first_step);
    double force = 0.0;
    block.code.funcs.decode = block.value.funcs.decode = read_values;
    block.code.arg = block.value.arg = &block;
    count = 0;
    if (!pb_decode(&stream, hertzloop_DaqBlock_fields, &block)) give_up("malformed samples");
    if (block.run_id != hello.run_id || block.sequence != heard++) give_up("samples were lost");
    size_t came = count;
    for (size_t i = 0; i < came; i++) {
        force = command(values[i]);
        for (int k = 0; k < every; k++) { /* it holds until the next one's force acts */
            if (known == FORCES) give_up("too many forces: give the plant a smaller --max-exchange-steps");
            forces[known++] = force;
        }
    }
    count = known < steps ? known : steps;
    hertzloop_ForceBlock answer = hertzloop_ForceBlock_init_zero;
    pb_ostream_t out = pb_ostream_from_buffer(outbox, sizeof outbox);
    answer.run_id = hello.run_id, answer.sequence = messages++;
    answer.first_step = (uint64_t)first_step, answer.step_ns = hello.step_ns;
    answer.samples_seen = (uint64_t)samples;
    answer.zero_until_trigger = mode == 0 && force == 0.0;
    answer.force_n.funcs.encode = write_forces;
    if (!pb_encode(&out, hertzloop_ForceBlock_fields, &answer)) give_up("the answer is too long");
    publish(&force_stream, out.bytes_written);
    first_step += (int64_t)count;
    count = 0;
    if (samples == ((int64_t)hello.steps + every - 1) / every) say_end("");
}

static bool read_fault(pb_istream_t *stream, const pb_field_t *field, void **arg) {
    (void)field;
    *(int *)*arg = stream->bytes_left > 0;
    return pb_read(stream, NULL, stream->bytes_left);
}

/* --- Session --- */

static char root[160];

static const z_loaned_keyexpr_t *key_of(z_view_keyexpr_t *made, char text[256], const char *rest) {
    snprintf(text, 256, "%s/%s", root, rest);
    if (z_view_keyexpr_from_str(made, text) < 0) give_up("%s is no key", text);
    return z_view_keyexpr_loan(made);
}

/* TLS from the file of a role that `hertzloop node keys` has written. */
static void secure(z_loaned_config_t *config, const char *path) {
    static const struct {
        uint8_t key;
        const char *name;
    } parts[] = {
        {Z_CONFIG_TLS_ROOT_CA_CERTIFICATE_BASE64_KEY, "root_ca_certificate_base64"},
        {Z_CONFIG_TLS_LISTEN_CERTIFICATE_BASE64_KEY, "listen_certificate_base64"},
        {Z_CONFIG_TLS_LISTEN_PRIVATE_KEY_BASE64_KEY, "listen_private_key_base64"},
        {Z_CONFIG_TLS_CONNECT_CERTIFICATE_BASE64_KEY, "connect_certificate_base64"},
        {Z_CONFIG_TLS_CONNECT_PRIVATE_KEY_BASE64_KEY, "connect_private_key_base64"},
    };
    static char text[1 << 16];
    FILE *file = fopen(path, "r");
    if (!file) give_up("cannot read %s", path);
    text[fread(text, 1, sizeof text - 1, file)] = 0;
    fclose(file);
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        char *found = strstr(text, parts[i].name), *end;
        if (!found || !(found = strchr(found, ':')) || !(found = strchr(found, '"'))) found = NULL;
        if (!found || !(end = strchr(found + 1, '"'))) give_up("%s has no %s", path, parts[i].name);
        *end = 0;
        zp_config_insert(config, parts[i].key, found + 1);
        *end = '"';
    }
    zp_config_insert(config, Z_CONFIG_TLS_ENABLE_MTLS_KEY, "true");
    zp_config_insert(config, Z_CONFIG_TLS_VERIFY_NAME_ON_CONNECT_KEY, "true");
}

static z_owned_session_t session;

static void open_session(char **given, int count_given) {
    for (int tries = 0;; tries++) { /* the plant may start later */
        z_owned_config_t config;
        z_config_default(&config);
        z_loaned_config_t *own = z_config_loan_mut(&config);
        zp_config_insert(own, Z_CONFIG_MODE_KEY, "peer");
        zp_config_insert(own, Z_CONFIG_LISTEN_KEY, given[2]);
        zp_config_insert(own, Z_CONFIG_CONNECT_KEY, given[3]);
        if (count_given > 4) secure(own, given[4]);
        if (z_open(&session, z_config_move(&config), NULL) >= 0) return;
        if (tries == 10 * WAIT_S) give_up("cannot connect to the plant at %s", given[3]);
        z_sleep_ms(100);
    }
}

int main(int count_given, char **given) {
    if (count_given < 4) give_up("usage: %s NAME LISTEN CONNECT [controller.json5]", given[0]);
    snprintf(root, sizeof root, "hertzloop/%s", given[1]);
    open_session(given, count_given);
    const z_loaned_session_t *own = z_session_loan(&session);
    z_view_keyexpr_t made;
    char text[256];

    static const char *streams[] = {"hello", "daq", "end/plant"};
    z_owned_subscriber_t subscribers[3], tokens[2];
    for (int i = 0; i < 3; i++) {
        z_owned_closure_sample_t closure;
        z_closure_sample(&closure, on_message, NULL, (void *)(intptr_t)i);
        if (z_declare_subscriber(own, &subscribers[i], key_of(&made, text, streams[i]),
                                 z_closure_sample_move(&closure), NULL) < 0)
            give_up("cannot subscribe");
    }
    z_publisher_options_t express;
    z_publisher_options_default(&express);
    express.congestion_control = Z_CONGESTION_CONTROL_BLOCK;
    express.is_express = true;
    if (z_declare_publisher(own, &force_stream, key_of(&made, text, "force"), &express) < 0 ||
        z_declare_publisher(own, &end_stream, key_of(&made, text, "end/controller"), &express) < 0)
        give_up("cannot publish");
    for (int i = 0; i < 2; i++) {
        z_owned_closure_sample_t closure;
        z_liveliness_subscriber_options_t history;
        z_liveliness_subscriber_options_default(&history);
        history.history = true;
        z_closure_sample(&closure, on_token, NULL, NULL);
        if (z_liveliness_declare_subscriber(own, &tokens[i],
                                            key_of(&made, text, i ? "complete/*" : "alive/*/*"),
                                            z_closure_sample_move(&closure), &history) < 0)
            give_up("cannot subscribe to tokens");
    }
    z_owned_liveliness_token_t token;
    if (z_liveliness_declare_token(own, &token, key_of(&made, text, "alive/controller/pico"), NULL))
        give_up("cannot declare the token");

    pthread_mutex_lock(&lock);
    if (!wait_until(both_there, WAIT_S)) give_up("plant and recorder are not there");
    int over = 0, fault = 0, whole;
    while (!over) {
        if (!wait_until(something, hello.steps ? TIMEOUT_S : WAIT_S)) give_up("nothing came");
        if (too_large) give_up("a message of %d bytes came: raise MESSAGE_BYTES", too_large);
        if (put == taken) give_up("plant or recorder left the run");
        int kind = inbox[taken % SLOTS].kind;
        const uint8_t *bytes = inbox[taken % SLOTS].bytes;
        size_t size = inbox[taken % SLOTS].size;
        pthread_mutex_unlock(&lock);
        if (kind == HELLO) {
            hear_hello(bytes, size);
        } else if (kind == DAQ) {
            hear_daq(bytes, size);
        } else {
            hertzloop_RunEnd end = hertzloop_RunEnd_init_zero;
            pb_istream_t stream = pb_istream_from_buffer(bytes, size);
            end.fault.funcs.decode = read_fault;
            end.fault.arg = &fault;
            if (!pb_decode(&stream, hertzloop_RunEnd_fields, &end)) give_up("malformed end");
            if (fault && hello.steps) say_end("the plant ended the run");
            over = 1;
        }
        pthread_mutex_lock(&lock);
        taken++;
        pthread_cond_broadcast(&news);
    }
    whole = wait_until(recorder_gone, WAIT_S) && complete && !fault;
    pthread_mutex_unlock(&lock);
    z_liveliness_undeclare_token(z_liveliness_token_move(&token));
    for (int i = 0; i < 3; i++) z_undeclare_subscriber(z_subscriber_move(&subscribers[i]));
    for (int i = 0; i < 2; i++) z_undeclare_subscriber(z_subscriber_move(&tokens[i]));
    z_session_drop(z_session_move(&session));
    if (!whole) fprintf(stderr, "the run has not ended well\n");
    return !whole;
}
