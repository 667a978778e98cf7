"""The table of states in docs/nodes.md is that of the code."""
from pathlib import Path

from gdmp_ros.playback.states import Request, State, TABLE

PAGE = Path(__file__).parents[2] / 'docs' / 'nodes.md'


def name(state):
    return state.name.lower()


def documented():
    """Lines of the tables: what each state is, and what each request does."""
    reasons = sorted({item for row in TABLE.values() for item in row.values()
                      if isinstance(item, str)})
    lines = ['| state | `status` | what the server does |', '|---|---|---|']
    lines += [f'| {name(state)} | {state.status.value} | {state.value} |' for state in State]
    lines += ['', '| | ' + ' | '.join(request.value for request in Request) + ' |',
              '|---|' + '---|' * len(Request)]
    for state, row in TABLE.items():
        cells = [f'refused {reasons.index(item) + 1}' if isinstance(item, str)
                 else '' if item is state else name(item) for item in row.values()]
        lines.append(f'| {name(state)} | ' + ' | '.join(cells) + ' |')
    lines += ['', *(f'{number}. {reason}' for number, reason in enumerate(reasons, 1))]
    return '\n'.join(lines)


def test_the_page_has_the_table_of_the_code():
    assert documented() in PAGE.read_text(), documented()
