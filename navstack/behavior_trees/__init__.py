"""Behavior trees: Nav2's trees of BehaviorTree.CPP's XML, ticked in simulated time and explained.

`BehaviorTree("tree.xml", servers=..)` reads a tree; `tick(now)` runs it; `explain()` tells what it did.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.behavior_trees.actions import ServerAction as ServerAction
    from navstack.behavior_trees.actions import ServiceAction as ServiceAction
    from navstack.behavior_trees.blackboard import Blackboard as Blackboard
    from navstack.behavior_trees.blackboard import Port as Port
    from navstack.behavior_trees.blackboard import StampedPose as StampedPose
    from navstack.behavior_trees.blackboard import as_stamped as as_stamped
    from navstack.behavior_trees.blackboard import inputs as inputs
    from navstack.behavior_trees.blackboard import outputs as outputs
    from navstack.behavior_trees.errors import BehaviorTreeError as BehaviorTreeError
    from navstack.behavior_trees.errors import BehaviorTreeRunError as BehaviorTreeRunError
    from navstack.behavior_trees.nodes import Action as Action
    from navstack.behavior_trees.nodes import Condition as Condition
    from navstack.behavior_trees.nodes import Control as Control
    from navstack.behavior_trees.nodes import Decorator as Decorator
    from navstack.behavior_trees.nodes import Node as Node
    from navstack.behavior_trees.nodes import StatefulAction as StatefulAction
    from navstack.behavior_trees.nodes import Status as Status
    from navstack.behavior_trees.servers import ActionState as ActionState
    from navstack.behavior_trees.servers import ActionTicket as ActionTicket
    from navstack.behavior_trees.servers import NoServers as NoServers
    from navstack.behavior_trees.servers import Servers as Servers
    from navstack.behavior_trees.trace import Retry as Retry
    from navstack.behavior_trees.trace import Trace as Trace
    from navstack.behavior_trees.tree import NODES as NODES
    from navstack.behavior_trees.tree import BehaviorTree as BehaviorTree
    from navstack.behavior_trees.tree import find_tree as find_tree
    from navstack.behavior_trees.tree import packaged_trees as packaged_trees
else:
    from navstack._lazy import lazy_face

    __getattr__, __dir__, __all__ = lazy_face(__name__)
