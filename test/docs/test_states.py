"""The tables of states in docs/nodes.md are those of the code."""
from pathlib import Path

import pytest

from gdmp_ros.control import arm_states
from gdmp_ros.playback import states

PAGE = Path(__file__).parents[2] / 'docs' / 'nodes.md'


def name(state):
    return state.name.lower()


def documented_player():
    """Lines of the tables: what each state is, and what each request does."""
    reasons = sorted({item for row in states.TABLE.values() for item in row.values()
                      if isinstance(item, str)})
    lines = ['| state | `status` | what the server does |', '|---|---|---|']
    lines += [f'| {name(state)} | {state.status.value} | {state.value} |'
              for state in states.State]
    lines += ['', '| | ' + ' | '.join(request.value for request in states.Request) + ' |',
              '|---|' + '---|' * len(states.Request)]
    for state, row in states.TABLE.items():
        cells = [f'refused {reasons.index(item) + 1}' if isinstance(item, str)
                 else '' if item is state else name(item) for item in row.values()]
        lines.append(f'| {name(state)} | ' + ' | '.join(cells) + ' |')
    lines += ['', *(f'{number}. {reason}' for number, reason in enumerate(reasons, 1))]
    return '\n'.join(lines)


def documented_arm():
    """As `documented_player`, a line for each request."""
    table = arm_states.TABLE
    reasons = sorted({item for row in table.values() for item in row.values()
                      if isinstance(item, str) and item})

    def cell(state, item):
        if isinstance(item, str):
            return f'refused {reasons.index(item) + 1}' if item else 'ignored'
        if isinstance(item, arm_states.Stop):
            return f'stopping, then {name(item.then)}'
        return '' if item is state else name(item)
    lines = ['| state | `mode` | what the arm does |', '|---|---|---|']
    lines += [f'| {name(state)} | {state.mode.name} | {state.value} |'
              for state in arm_states.State]
    lines += ['', '| | ' + ' | '.join(map(name, table)) + ' |', '|---|' + '---|' * len(table)]
    for request in arm_states.Request:
        cells = [cell(state, row[request]) for state, row in table.items()]
        lines.append(f'| {request.value} | ' + ' | '.join(cells) + ' |')
    lines += ['', *(f'{number}. {reason.format("…")}' for number, reason in enumerate(reasons, 1))]
    return '\n'.join(lines)


@pytest.mark.parametrize('documented', [documented_player, documented_arm])
def test_the_page_has_the_table_of_the_code(documented):
    assert documented() in PAGE.read_text(), documented()


def test_every_request_of_an_arm_has_a_result_in_every_state():
    assert set(arm_states.TABLE) == set(arm_states.State)
    assert all(set(row) == set(arm_states.Request) for row in arm_states.TABLE.values())
