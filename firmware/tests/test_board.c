// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The rules of docs/protocol.md, each test beginning with the names of those that it is about.
#include "bench.h"

static uint32_t sequence_of(const posfet_frame *block) {
    return posfet_get_u32(block->data);
}

static uint32_t time_of_block(const posfet_frame *block) {
    return posfet_get_u32(block->data + 4);
}

static unsigned flags_of(const posfet_frame *block) {
    return block->data[9] & 15U;
}

static posfet_config classic_config(void) {
    posfet_config config = bench_config();
    config.fd = config.rate_switch = false;
    return config;
}

static const posfet_frame *fd_scan(unsigned from, unsigned n) {
    const int at = find_frame(POSFET_SCAN_BLOCK_FD, from, n);
    CHECK(at >= 0);
    return &hw.sent[at];
}

static void t1_t2_ticks_are_counted_from_power_on_while_stopped(void) {
    const posfet_config config = bench_config();
    power_on(&config, 12345);
    run_for(7500);
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK_FD, 0), 0);
    const answer started = command(POSFET_START, 0);
    CHECK_EQUAL(started.result, POSFET_OK);
    CHECK_EQUAL(started.value, 8);
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK_FD, 0), 0);
    run_for(3000);
    for (unsigned n = 0; n < 3; n++) {
        CHECK_EQUAL(sequence_of(fd_scan(0, n)), 8 + n);
        CHECK_EQUAL(time_of_block(fd_scan(0, n)), 8000 + 1000 * n);
    }
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK_FD, 0), 3);
}

static void s1_stop_names_the_first_scan_that_is_not_sent(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(4999);
    const answer stopped = command(POSFET_STOP, 0);
    CHECK_EQUAL(stopped.value, 5);
    CHECK_EQUAL(sequence_of(fd_scan(0, 3)), 4);
    run_for(5001);
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK_FD, 0), 4);
    CHECK_EQUAL(command(POSFET_START, 0).value, 11);
    run_for(1000);
    CHECK_EQUAL(sequence_of(fd_scan(0, 4)), 11);
}

static void s1_ticks_that_nobody_has_polled_for_come_before_the_command(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.clock += 5500;
    CHECK_EQUAL(command(POSFET_START, 0).value, 6);
    hw.clock += 1000;
    const answer stopped = command(POSFET_STOP, 0);
    CHECK_EQUAL(stopped.value, 7);
    CHECK_EQUAL(sequence_of(fd_scan(0, 0)), 6);
    CHECK((unsigned)find_frame(POSFET_SCAN_BLOCK_FD, 0, 0) < stopped.at);
}

static void c7_start_and_stop_twice_change_nothing(void) {
    const posfet_config config = classic_config();
    power_on(&config, 0);
    CHECK_EQUAL(command(POSFET_STOP, 0).result, POSFET_OK);
    command(POSFET_START, 0);
    run_for(1500);
    const unsigned from = hw.count;
    const answer again = command(POSFET_START, 0);
    CHECK_EQUAL(again.result, POSFET_OK);
    CHECK_EQUAL(again.value, 2);
    run_for(10000);
    CHECK_EQUAL(frames_with(POSFET_SCAN_HEADER, from), 0);
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK, from), 10);
}

static void s2_headers_stand_directly_before_the_scans_that_need_one(void) {
    const posfet_config config = classic_config();
    power_on(&config, 0);
    run_for(4500);
    command(POSFET_START, 0); // first scan: 5
    run_for(30000);           // up to 34
    CHECK_EQUAL(command(POSFET_SET_RATE, 2000).result, POSFET_OK);
    run_for(4000); // 35 at 36 ms, 36 at 38 ms
    command(POSFET_SET_RATE, 2000);
    run_for(2000);
    static const uint32_t wanted[][2] = {{5, 5000}, {16, 16000}, {32, 32000}, {35, 36000}};
    for (unsigned n = 0; n < 4; n++) {
        const int at = find_frame(POSFET_SCAN_HEADER, 0, n);
        CHECK(at >= 0);
        CHECK_EQUAL(sequence_of(&hw.sent[at]), wanted[n][0]);
        CHECK_EQUAL(posfet_get_u32(hw.sent[at].data + 4), wanted[n][1] | 7U << 28);
        CHECK_EQUAL(offset_of(&hw.sent[at + 1]), POSFET_SCAN_BLOCK);
        CHECK_EQUAL(hw.sent[at + 1].data[0] & 15U, wanted[n][0] & 15U);
    }
    CHECK_EQUAL(frames_with(POSFET_SCAN_HEADER, 0), 4);
}

static void f3_blocks_ascend_and_scans_follow_one_another(void) {
    posfet_config config = classic_config();
    config.taxels = 23;
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(40000);
    unsigned block = 0;
    unsigned counter = 1;
    for (unsigned i = 0; i < hw.count; i++) {
        const uint32_t offset = offset_of(&hw.sent[i]);
        if (offset < POSFET_SCAN_BLOCK) continue;
        CHECK_EQUAL(offset, POSFET_SCAN_BLOCK + block);
        CHECK_EQUAL(hw.sent[i].data[0] & 15U, counter & 15U);
        if (block == 4) CHECK_EQUAL(hw.sent[i].data[6] | hw.sent[i].data[7] | hw.sent[i].data[5] >> 4, 0); // S3
        if (++block == 5) {
            block = 0;
            counter++;
        }
    }
    CHECK_EQUAL(counter, 41);
}

static void s4_blocks_of_a_scan_agree(void) {
    posfet_config config = bench_config();
    config.taxels = 60;
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(1000);
    CHECK_EQUAL(frames_with(POSFET_SCAN_BLOCK_FD, 0), 3);
    for (unsigned n = 0; n < 3; n++) {
        const posfet_frame *block = fd_scan(0, n);
        CHECK_EQUAL(block->data[8], n);
        CHECK(memcmp(block->data, fd_scan(0, 0)->data, 8) == 0);
        CHECK_EQUAL(block->data[9], fd_scan(0, 0)->data[9]);
        for (unsigned i = 0; i < 26; i++) {
            const unsigned count = block->data[12 + 2 * i] | (unsigned)block->data[13 + 2 * i] << 8;
            CHECK_EQUAL(count, 26 * n + i < 60 ? hw.counts[26 * n + i] : 0);
        }
    }
}

static void t3_a_new_period_counts_from_the_latest_tick(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(2300); // latest tick: 2 at 2000
    CHECK_EQUAL(command(POSFET_SET_RATE, 5000).value, 5000);
    run_for(10000);
    CHECK_EQUAL(time_of_block(fd_scan(0, 2)), 7000);
    CHECK_EQUAL(sequence_of(fd_scan(0, 2)), 3);
    CHECK_EQUAL(time_of_block(fd_scan(0, 3)), 12000);
    run_for(3700); // 16000, 4000 after the latest tick
    command(POSFET_SET_RATE, 3000);
    CHECK_EQUAL(time_of_block(fd_scan(0, 4)), 16000); // at once
    CHECK_EQUAL(sequence_of(fd_scan(0, 4)), 5);
    CHECK_EQUAL(flags_of(fd_scan(0, 4)), 0);
    run_for(3000);
    CHECK_EQUAL(time_of_block(fd_scan(0, 5)), 19000);
}

static void t3_t4_so_it_does_while_stopped(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    run_for(2300);
    command(POSFET_SET_RATE, 10000); // ticks 3 at 12000, 4 at 22000
    run_for(20000);
    CHECK_EQUAL(command(POSFET_START, 0).value, 5);
    run_for(10000);
    CHECK_EQUAL(time_of_block(fd_scan(0, 0)), 32000);
}

static void c6_periods_that_cannot_be_kept_are_refused(void) {
    posfet_config config = bench_config();
    config.period_step_us = 250;
    power_on(&config, 0);
    static const uint32_t refused[] = {0, 1, 750, 999, 1001, 10000250, UINT32_MAX};
    for (unsigned i = 0; i < sizeof refused / sizeof *refused; i++) {
        const answer got = command(POSFET_SET_RATE, refused[i]);
        CHECK_EQUAL(got.result, POSFET_BAD_ARGUMENT);
        CHECK_EQUAL(got.value, 0);
        CHECK_EQUAL(board.period_us, 1000);
    }
    static const uint32_t accepted[] = {1000, 1250, 10000000};
    for (unsigned i = 0; i < sizeof accepted / sizeof *accepted; i++) {
        const answer got = command(POSFET_SET_RATE, accepted[i]);
        CHECK_EQUAL(got.result, POSFET_OK);
        CHECK_EQUAL(got.value, accepted[i]);
    }
}

static void i2_identity_follows_the_response(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    const answer identified = command(POSFET_IDENTIFY, 0);
    CHECK_EQUAL(identified.value, 0x03120001);
    CHECK_EQUAL(offset_of(&hw.sent[identified.at + 1]), POSFET_IDENTITY);
    const answer set = command(POSFET_SET_RATE, 4000);
    const posfet_frame *identity = &hw.sent[set.at + 1];
    CHECK_EQUAL(offset_of(identity), POSFET_IDENTITY);
    CHECK_EQUAL(posfet_get_u32(identity->data), 0x03120001);
    CHECK_EQUAL(posfet_get_u32(identity->data + 4), 4U | 4000U << 8);
    const unsigned from = hw.count;
    command(POSFET_SET_RATE, 1);
    command(POSFET_IDENTIFY, 1);
    CHECK_EQUAL(frames_with(POSFET_IDENTITY, from), 0);
}

static void i1_i2_i3_reports_keep_their_periods(void) {
    const posfet_config config = bench_config();
    power_on(&config, UINT64_C(0xFFFF0000)); // the port's clock wraps after 65 ms
    run_for(1000000 - 1);
    command(POSFET_START, 0);
    run_for(2000001);
    CHECK_EQUAL(frames_with(POSFET_STATUS, 0), 31);
    for (unsigned n = 0; n < 31; n++) {
        const int at = find_frame(POSFET_STATUS, 0, n);
        CHECK_EQUAL(hw.sent_at[at] - 0xFFFF0000, 100000 * n);
        CHECK_EQUAL(hw.sent[at].data[7], (n & 15U) << 4 | 7U);
        CHECK_EQUAL(hw.sent[at].data[6], n >= 10 ? 0x10 : 0);
    }
    CHECK_EQUAL(frames_with(POSFET_IDENTITY, 0), 4);
    for (unsigned n = 0; n < 4; n++)
        CHECK_EQUAL(hw.sent_at[find_frame(POSFET_IDENTITY, 0, n)] - 0xFFFF0000, 1000000 * n);
}

static void i1_a_late_report_does_not_shift_the_next(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.clock += 230000;
    posfet_board_poll(&board);
    CHECK_EQUAL(frames_with(POSFET_STATUS, 0), 2);
    run_for(70000);
    CHECK_EQUAL(hw.sent_at[find_frame(POSFET_STATUS, 0, 2)], 300000);
}

static const posfet_frame *next_status(void) {
    const unsigned from = hw.count;
    run_for(100000);
    const int at = find_frame(POSFET_STATUS, from, 0);
    CHECK(at >= 0);
    return &hw.sent[at];
}

static void i5_old_measurements_are_unknown(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.measures_now = false;
    hw.measured_us = 50000;
    hw.temperatures[1] = 86 * 256;
    hw.supply_mv = 2999;
    const posfet_frame *status = NULL;
    for (unsigned n = 0; n < 10; n++) { // to an age of 0.95 s
        status = next_status();
        CHECK_EQUAL(status->data[4] | status->data[5] << 8, 2999);
        CHECK_EQUAL(status->data[2] | status->data[3] << 8, 86 * 256);
        CHECK_EQUAL(status->data[6], POSFET_SUPPLY_LOW | POSFET_OVERTEMPERATURE);
    }
    status = next_status();
    CHECK(memcmp(status->data, "\x00\x80\x00\x80\xFF\xFF\x00", 7) == 0);
    hw.measured_us = (uint32_t)hw.clock;
    CHECK_EQUAL(next_status()->data[6], POSFET_SUPPLY_LOW | POSFET_OVERTEMPERATURE);
}

static void i5_an_old_measurement_stays_unknown_when_the_clock_wraps(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.measures_now = false;
    hw.measured_us = 0;
    hw.room = 0;
    for (unsigned n = 0; n < 5; n++) { // 2^32 us and a little more
        hw.clock += UINT64_C(0x40000000);
        posfet_board_poll(&board);
    }
    hw.clock = UINT64_C(0x100000000) + 500000; // looks like 0.5 s
    hw.clock += UINT64_C(0x100000000);
    hw.room = UINT32_MAX;
    posfet_board_poll(&board);
    CHECK(memcmp(next_status()->data, "\x00\x80\x00\x80\xFF\xFF", 6) == 0);
}

static void flags_are_in_scans_and_status(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(1000);
    CHECK_EQUAL(flags_of(fd_scan(0, 0)), 0);
    hw.supply_mv = 2900;
    hw.adc_fails = true;
    CHECK_EQUAL(next_status()->data[6], 0x10 | POSFET_SUPPLY_LOW | POSFET_ADC_FAULT);
    CHECK_EQUAL(flags_of(&hw.sent[hw.count - 1]), POSFET_SUPPLY_LOW | POSFET_ADC_FAULT);
    hw.adc_fails = false;
    hw.supply_mv = 3000;
    hw.temperatures[0] = 85 * 256 + 1;
    CHECK_EQUAL(next_status()->data[6], 0x10 | POSFET_OVERTEMPERATURE);
}

static void i6_status_says_whether_power_on_resets_the_charge(void) {
    posfet_config config = bench_config();
    power_on(&config, 0);
    CHECK_EQUAL(next_status()->data[6], 0);
    config.charge_reset = true;
    power_on(&config, 0);
    CHECK_EQUAL(next_status()->data[6], 0x20);
}

static void c1_other_frames_are_ignored(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    const unsigned from = hw.count;
    posfet_frame frame = command_frame(POSFET_START, 1, 0);
    for (uint8_t length = 0; length < 8; length++) {
        frame.length = length;
        CHECK(posfet_board_receive(&board, &frame));
    }
    frame.length = 8;
    static const uint8_t kinds[] = {POSFET_EXTENDED, POSFET_REMOTE, POSFET_FD, POSFET_FD | POSFET_RATE_SWITCH};
    for (unsigned i = 0; i < sizeof kinds; i++) {
        frame.flags = kinds[i];
        CHECK(posfet_board_receive(&board, &frame));
    }
    frame.flags = 0;
    for (frame.id = 0; frame.id <= POSFET_HIGHEST_ID; frame.id++)
        if (frame.id != 0x100) CHECK(posfet_board_receive(&board, &frame));
    CHECK_EQUAL(hw.count, from);
    CHECK(!board.scanning);
}

static void c3_c4_c5_refused_commands_have_no_effect(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    for (unsigned code = 0; code < 256; code++) {
        if (code >= POSFET_START && code <= POSFET_SELF_TEST) continue;
        const answer got = command((uint8_t)code, 5);
        CHECK_EQUAL(got.result, POSFET_UNKNOWN_COMMAND);
        CHECK_EQUAL(got.value, 0);
    }
    static const uint8_t without_argument[] = {POSFET_START, POSFET_STOP, POSFET_IDENTIFY, POSFET_SELF_TEST};
    for (unsigned i = 0; i < sizeof without_argument; i++) {
        const answer got = command(without_argument[i], 0x80000000);
        CHECK_EQUAL(got.result, POSFET_BAD_ARGUMENT);
        CHECK_EQUAL(got.value, 0);
    }
    CHECK(!board.scanning);
    posfet_frame frame = command_frame(POSFET_START, 9, 0);
    frame.data[2] = frame.data[3] = 0xFF; // F2: reserved bits
    const unsigned from = hw.count;
    CHECK(posfet_board_receive(&board, &frame));
    CHECK_EQUAL(hw.sent[from].data[2], POSFET_OK);
    CHECK(board.scanning);
}

static void c8_self_test(void) {
    posfet_config config = bench_config();
    power_on(&config, 0);
    CHECK_EQUAL(command(POSFET_SELF_TEST, 0).result, POSFET_OK);
    hw.found = POSFET_ADC_FAULT;
    hw.supply_mv = 1000;
    const answer failed = command(POSFET_SELF_TEST, 0);
    CHECK_EQUAL(failed.result, POSFET_FAILED);
    CHECK_EQUAL(failed.value, POSFET_ADC_FAULT | POSFET_SUPPLY_LOW);
    command(POSFET_START, 0);
    const answer busy = command(POSFET_SELF_TEST, 0);
    CHECK_EQUAL(busy.result, POSFET_BUSY);
    CHECK_EQUAL(busy.value, 0);
    config.tests_while_scanning = true;
    power_on(&config, 0);
    command(POSFET_START, 0);
    CHECK_EQUAL(command(POSFET_SELF_TEST, 0).result, POSFET_OK);
}

static void t1_the_timer_runs_on_through_a_long_self_test(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.test_us = 80500;
    command(POSFET_SELF_TEST, 0);
    CHECK_EQUAL(command(POSFET_START, 0).value, 81);
    run_for(1000);
    CHECK_EQUAL(flags_of(fd_scan(0, 0)), 0); // no scan was asked for meanwhile
}

static void t5_a_late_board_leaves_out_scans_and_says_so(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(2000);
    hw.clock += 3400; // ticks 3 and 4 pass, 5 is late
    posfet_board_poll(&board);
    CHECK_EQUAL(sequence_of(fd_scan(0, 2)), 5);
    CHECK_EQUAL(time_of_block(fd_scan(0, 2)), 5400);
    CHECK_EQUAL(flags_of(fd_scan(0, 2)), POSFET_SCAN_OVERRUN);
    run_for(600);
    CHECK_EQUAL(sequence_of(fd_scan(0, 3)), 6);
    CHECK_EQUAL(time_of_block(fd_scan(0, 3)), 6000);
    CHECK_EQUAL(flags_of(fd_scan(0, 3)), 0);
}

static void t5_a_full_queue_leaves_out_whole_scans(void) {
    posfet_config config = classic_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(16500);
    const unsigned before = hw.count;
    hw.room = 2; // block 0 and 1 of scan 17
    run_for(700000);
    CHECK_EQUAL(hw.count, before + 2);
    CHECK(board.queue_length <= POSFET_QUEUE_FRAMES);
    hw.room = UINT32_MAX;
    run_for(100000);
    unsigned block = 0;
    int64_t scan = 17;
    unsigned gaps = 0;
    for (unsigned i = before; i < hw.count; i++) {
        const uint32_t offset = offset_of(&hw.sent[i]);
        if (offset < POSFET_SCAN_BLOCK) continue;
        CHECK_EQUAL(offset, POSFET_SCAN_BLOCK + block); // no scan is cut
        const unsigned counter = hw.sent[i].data[0] & 15U;
        if (block == 0 && scan != 17 && counter != ((unsigned)scan & 15U)) gaps++;
        if (block == 0 && counter != ((unsigned)scan & 15U)) scan = counter;
        CHECK_EQUAL(counter, (unsigned)scan & 15U);
        if (++block == 5) {
            block = 0;
            scan++;
        }
    }
    CHECK(gaps <= 1);
    // What waited tells of the overrun in the status, and the end of it.
    bool told = false;
    for (unsigned n = 0; find_frame(POSFET_STATUS, before, n) >= 0; n++)
        if (hw.sent[find_frame(POSFET_STATUS, before, n)].data[6] & POSFET_SCAN_OVERRUN) told = true;
    CHECK(told);
    CHECK_EQUAL(next_status()->data[6], 0x10);
    // Sequences are those of the timer, as if nothing had happened.
    CHECK_EQUAL(command(POSFET_STOP, 0).value, hw.clock / 1000 + 1);
}

static void t5_the_flag_stays_until_a_scan_was_sent_without_delay(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(1000);
    const unsigned from = hw.count;
    hw.room = 0;
    run_for(500000);
    // A bus that takes one frame per tick, so that something always waits.
    for (unsigned n = 0; n < 100; n++) {
        hw.room = 1;
        run_for(1000);
    }
    bool missing = false;
    uint32_t last = 1;
    for (unsigned n = 0; find_frame(POSFET_SCAN_BLOCK_FD, from, n) >= 0; n++) {
        const posfet_frame *block = fd_scan(from, n);
        missing = missing || sequence_of(block) != last + 1;
        last = sequence_of(block);
        CHECK_EQUAL(flags_of(block), missing ? POSFET_SCAN_OVERRUN : 0);
    }
    CHECK(missing);
    hw.room = UINT32_MAX;
    run_for(3000);
    CHECK_EQUAL(flags_of(&hw.sent[hw.count - 1]), 0);
}

static void c2_responses_keep_their_order_and_nothing_is_lost_on_a_blocked_bus(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    run_for(1000);
    hw.room = 0;
    run_for(400000);
    const unsigned from = hw.count;
    uint8_t taken = 0;
    for (uint8_t tag = 0; tag < 250; tag++) {
        const posfet_frame frame = command_frame(POSFET_SET_RATE, tag, 1000U + tag);
        if (!posfet_board_receive(&board, &frame)) break;
        taken++;
    }
    CHECK(taken < 250);
    CHECK_EQUAL(board.period_us, 1000 + taken - 1); // the one that was not taken had no effect
    hw.room = UINT32_MAX;
    posfet_board_poll(&board);
    CHECK_EQUAL(frames_with(POSFET_RESPONSE, from), taken);
    for (unsigned n = 0; n < taken; n++)
        CHECK_EQUAL(hw.sent[find_frame(POSFET_RESPONSE, from, n)].data[1], n);
    const posfet_frame frame = command_frame(POSFET_SET_RATE, taken, 1000U + taken);
    CHECK(posfet_board_receive(&board, &frame));
}

static void t4_times_and_sequences_wrap(void) {
    posfet_config config = classic_config();
    power_on(&config, UINT32_MAX - 5);
    command(POSFET_START, 0);
    run_for(1000);
    command(POSFET_STOP, 0);
    // To shortly before 2^28 us, then 2^32 us and sequence 2^32, with a port whose clock wraps as well.
    hw.clock += (UINT64_C(1) << 28) - 1000 - 457;
    posfet_board_poll(&board);
    const uint64_t sequence = (UINT64_C(1) << 28) / 1000;
    CHECK_EQUAL(command(POSFET_START, 0).value, sequence);
    unsigned from = hw.count;
    run_for(1000);
    CHECK_EQUAL(sequence_of(&hw.sent[find_frame(POSFET_SCAN_HEADER, from, 0)]), sequence);
    CHECK_EQUAL(posfet_get_u32(hw.sent[find_frame(POSFET_SCAN_HEADER, from, 0)].data + 4),
                (sequence * 1000) | 7U << 28);
    command(POSFET_SET_RATE, 1001);
    from = hw.count;
    run_for(1001);
    CHECK_EQUAL(posfet_get_u32(hw.sent[find_frame(POSFET_SCAN_HEADER, from, 0)].data + 4),
                ((sequence * 1000 + 1001) & 0x0FFFFFFFU) | 7U << 28);

    command(POSFET_STOP, 0);
    config.fd = true;
    power_on(&config, 99);
    while (board.next_sequence < UINT32_MAX - 1000000) { // 50 days of ticks
        hw.clock += UINT64_C(1) << 29;
        hw.count = 0;
        posfet_board_poll(&board);
    }
    hw.count = 0;
    run_for((UINT32_MAX - 1 - board.next_sequence) * UINT64_C(1000));
    CHECK_EQUAL(board.next_sequence, UINT32_MAX - 1);
    command(POSFET_START, 0);
    from = hw.count;
    run_for(4000);
    for (unsigned n = 0; n < 4; n++) {
        CHECK_EQUAL(sequence_of(fd_scan(from, n)), (uint32_t)(UINT32_MAX - 1 + n));
        CHECK_EQUAL(time_of_block(fd_scan(from, n)), (uint32_t)((UINT64_C(0xFFFFFFFE) + n) * 1000));
    }
    CHECK_EQUAL(command(POSFET_STOP, 0).value, 2);
}

static void t4_the_time_is_that_of_the_sampling(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    command(POSFET_START, 0);
    hw.sampled_before_us = 40; // a timer started the ADC, and the interrupt is late
    hw.clock += 1040;
    posfet_board_poll(&board);
    CHECK_EQUAL(time_of_block(fd_scan(0, 0)), 1000);
    hw.sampled_before_us = 0;
    hw.sampled_after_us = 15; // the port has taken its time before it began
    run_for(960);
    CHECK_EQUAL(time_of_block(fd_scan(0, 1)), 2015);
}

static void impossible_configurations_are_refused(void) {
    posfet_config config = bench_config();
#define REFUSED(field, number)                                                                                         \
    do {                                                                                                               \
        config = bench_config();                                                                                       \
        config.field = (number);                                                                                       \
        CHECK(!posfet_board_init(&board, &config, &bench_port));                                                       \
    } while (0)
    REFUSED(taxels, 0);
    REFUSED(taxels, POSFET_MAX_TAXELS + 1);
    REFUSED(layout_id, 0);
    REFUSED(base_id, 0x7FB);
    REFUSED(base_id, UINT32_MAX);
    REFUSED(shortest_period_us, 0);
    REFUSED(shortest_period_us, 10000001);
    REFUSED(period_step_us, 0);
    REFUSED(period_step_us, 300);
    config = classic_config();
    config.base_id = 0x7F4; // the last of 5 blocks is at 0x800
    CHECK(!posfet_board_init(&board, &config, &bench_port));
    config.base_id = 0x7F3;
    CHECK(posfet_board_init(&board, &config, &bench_port));
    config = bench_config();
    config.base_id = 0x7FA;
    CHECK(posfet_board_init(&board, &config, &bench_port));
}

static void a_board_with_a_full_queue_waits_for_the_bus(void) {
    const posfet_config config = bench_config();
    power_on(&config, 0);
    hw.room = 0;
    run_for(200000);
    for (unsigned n = 0; n < POSFET_QUEUE_FRAMES; n++) {
        const posfet_frame frame = command_frame(0, 0, 0);
        if (!posfet_board_receive(&board, &frame)) break;
    }
    CHECK_EQUAL(board.queue_length, POSFET_QUEUE_FRAMES - 1); // a command may need two
    run_for(5000000);                                         // returns: what waits for room is not due
    CHECK(board.queue_length == POSFET_QUEUE_FRAMES);
}

static uint32_t random_state = 7;

static uint32_t random_below(uint32_t limit) {
    random_state = random_state * 1664525U + 1013904223U;
    return (random_state >> 8) % limit;
}

static void any_course_of_commands_delays_and_blockages_keeps_the_order(void) {
    for (unsigned round = 0; round < 60; round++) {
        posfet_config config = round & 1U ? bench_config() : classic_config();
        config.taxels = (uint16_t)(1 + random_below(60));
        power_on(&config, (uint64_t)random_below(1U << 24) << 16);
        unsigned accepted = 0;
        for (unsigned step = 0; step < 400; step++) {
            hw.clock += random_below(random_below(8) == 0 ? 3000000 : 1500);
            hw.room = random_below(4) == 0 ? random_below(4) : UINT32_MAX;
            const uint32_t argument = random_below(3) == 0 ? 900 + random_below(400) : 0;
            const posfet_frame frame = command_frame((uint8_t)random_below(8), (uint8_t)accepted, argument);
            if (random_below(3) != 0)
                posfet_board_poll(&board);
            else if (posfet_board_receive(&board, &frame))
                accepted++;
        }
        hw.room = UINT32_MAX;
        posfet_board_poll(&board);

        CHECK_EQUAL(board.queue_length, 0);
        CHECK_EQUAL(frames_with(POSFET_RESPONSE, 0), accepted);
        unsigned responses = 0;
        unsigned beats = 0;
        unsigned block = 0;
        int64_t last = -1;
        const unsigned blocks = config.fd ? posfet_fd_blocks(config.taxels) : posfet_classic_blocks(config.taxels);
        for (unsigned i = 0; i < hw.count; i++) {
            const posfet_frame *sent = &hw.sent[i];
            const uint32_t offset = offset_of(sent);
            if (offset == POSFET_RESPONSE) CHECK_EQUAL(sent->data[1], responses++ & 255U);
            if (offset == POSFET_STATUS) CHECK_EQUAL(sent->data[7] >> 4, beats++ & 15U);
            if (offset == POSFET_SCAN_BLOCK_FD) {
                CHECK_EQUAL(sent->data[8], block);
                if (block == 0)
                    CHECK(sequence_of(sent) > last);
                else
                    CHECK_EQUAL(sequence_of(sent), last);
                last = sequence_of(sent);
            } else if (offset == POSFET_SCAN_HEADER) {
                CHECK_EQUAL(block, 0);
                CHECK_EQUAL(offset_of(&hw.sent[i + 1]), POSFET_SCAN_BLOCK);
                CHECK_EQUAL(hw.sent[i + 1].data[0] & 15U, sent->data[0] & 15U);
                CHECK(sequence_of(sent) > last);
                last = sequence_of(sent);
                continue;
            } else if (offset >= POSFET_SCAN_BLOCK)
                CHECK_EQUAL(offset, POSFET_SCAN_BLOCK + block);
            else {
                CHECK_EQUAL(block, 0); // nothing stands between the blocks of a scan
                continue;
            }
            block = (block + 1) % blocks;
        }
        CHECK_EQUAL(block, 0);
    }
}

int main(void) {
    RUN(t1_t2_ticks_are_counted_from_power_on_while_stopped);
    RUN(s1_stop_names_the_first_scan_that_is_not_sent);
    RUN(s1_ticks_that_nobody_has_polled_for_come_before_the_command);
    RUN(c7_start_and_stop_twice_change_nothing);
    RUN(s2_headers_stand_directly_before_the_scans_that_need_one);
    RUN(f3_blocks_ascend_and_scans_follow_one_another);
    RUN(s4_blocks_of_a_scan_agree);
    RUN(t3_a_new_period_counts_from_the_latest_tick);
    RUN(t3_t4_so_it_does_while_stopped);
    RUN(c6_periods_that_cannot_be_kept_are_refused);
    RUN(i2_identity_follows_the_response);
    RUN(i1_i2_i3_reports_keep_their_periods);
    RUN(i1_a_late_report_does_not_shift_the_next);
    RUN(i5_old_measurements_are_unknown);
    RUN(i5_an_old_measurement_stays_unknown_when_the_clock_wraps);
    RUN(flags_are_in_scans_and_status);
    RUN(i6_status_says_whether_power_on_resets_the_charge);
    RUN(c1_other_frames_are_ignored);
    RUN(c3_c4_c5_refused_commands_have_no_effect);
    RUN(c8_self_test);
    RUN(t1_the_timer_runs_on_through_a_long_self_test);
    RUN(t5_a_late_board_leaves_out_scans_and_says_so);
    RUN(t5_a_full_queue_leaves_out_whole_scans);
    RUN(t5_the_flag_stays_until_a_scan_was_sent_without_delay);
    RUN(c2_responses_keep_their_order_and_nothing_is_lost_on_a_blocked_bus);
    RUN(t4_times_and_sequences_wrap);
    RUN(t4_the_time_is_that_of_the_sampling);
    RUN(impossible_configurations_are_refused);
    RUN(a_board_with_a_full_queue_waits_for_the_bus);
    RUN(any_course_of_commands_delays_and_blockages_keeps_the_order);
    return 0;
}
